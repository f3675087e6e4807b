"""Layout of a recording: names of entities and of the timeline, colours, and sending in a reproducible order.

Everything under ``WORLD`` is in the local east-north-up frame in metres, everything under ``MAP`` in degrees of latitude and
longitude. Readers of recordings depend on ``TIMELINE`` and ``TRACK``; the rest is only for display.
"""

import contextlib
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from mission_io.data_tables import data_table
from uavcover.errors import InputError

if TYPE_CHECKING:
    from uavcover.scenario.site import Site

# Sizes and times of recordings; ``data/recording.toml`` explains each.


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    max_nodes_per_side: int
    texture_pixels: int
    max_labels: int
    outline_pieces_per_side: int
    tick_s: float
    tile_side_cells: int
    directions: int
    steps: int
    level_cos: float
    vehicle_step_s: float
    heading_share: float
    camera_edges: int
    piece_s: float
    longest_name: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Views:
    played_in_s: float
    tile_pixels: float
    map_pixels: float
    link_window_s: float
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Viewer:
    start_timeout_s: float
    load_timeout_s: float
    poll_s: float
    settle_s: float
    ending_s: float


SCENE = data_table(_Scene, "uavcover/data/recording.toml", "scene")
VIEWS = data_table(_Views, "uavcover/data/recording.toml", "views")
VIEWER = data_table(_Viewer, "uavcover/data/recording.toml", "viewer")


_NOT_IN_ENTRY_NAMES = re.compile(r"[^A-Za-z0-9 _:-]")


class RecordingError(InputError):
    """A recording that cannot be written as asked, read, or shown."""


TIMELINE: Final = "mission_time"
"""Vehicle time, as a duration."""

WORLD: Final = "/world"
TERRAIN: Final = f"{WORLD}/terrain"
AREA: Final = f"{WORLD}/area"
FENCE: Final = f"{WORLD}/fence"
OBSTACLES: Final = f"{WORLD}/obstacles"
NO_FLY: Final = f"{WORLD}/no_fly"
HOME: Final = f"{WORLD}/home"
PLANNED: Final = f"{WORLD}/planned"
WAYPOINTS: Final = f"{PLANNED}/waypoints"
FLOWN: Final = f"{WORLD}/flown"
VEHICLE: Final = f"{WORLD}/vehicle"
HEADING: Final = f"{VEHICLE}/heading"
FOOTPRINT: Final = f"{WORLD}/footprint"
CAMERA: Final = f"{WORLD}/camera"
COVERAGE: Final = f"{WORLD}/coverage"

MAP: Final = "/map"
MAP_FLOWN: Final = f"{MAP}/flown"
MAP_VEHICLE: Final = f"{MAP}/vehicle"

SERIES: Final = "/series"
HEIGHT_AGL: Final = f"{SERIES}/height/above_ground_m"
HEIGHT_MIN: Final = f"{SERIES}/height/lowest_allowed_m"
HEIGHT_MAX: Final = f"{SERIES}/height/highest_allowed_m"
SEEN: Final = f"{SERIES}/coverage/seen_percent"
SEEN_COVERABLE: Final = f"{SERIES}/coverage/seen_of_coverable_percent"
GROUND_SPEED: Final = f"{SERIES}/speed/ground_m_s"
CLIMB_SPEED: Final = f"{SERIES}/speed/climb_m_s"
BATTERY_PERCENT: Final = f"{SERIES}/battery/left_percent"
BATTERY_V: Final = f"{SERIES}/battery/volts"
LINK_LOST: Final = f"{SERIES}/link/lost_percent"
LINK_RATE: Final = f"{SERIES}/link/messages_a_second"

EVENTS: Final = "/events"
LEGEND: Final = "/legend"
TRACK: Final = "/track"
"""The track in float64, one component for each column of ``track.csv``."""

SAMPLE_COUNT: Final = "sample_count"
"""Static component of ``TRACK``: number of samples written, by which a reader detects a truncated recording."""

UNFINISHED: Final = "unfinished"
"""Static component of ``TRACK`` in a recording made during the flight."""

CELL_NUMBERS: Final = "cell_numbers"
"""Static component of every coverage tile: which cells of the area its points are."""

Rgb = tuple[int, int, int]

NO_FLY_RGB: Final[Rgb] = (224, 36, 160)
OBSTACLE_RGB: Final[Rgb] = (142, 111, 193)
PLANNED_RGB: Final[Rgb] = (255, 255, 255)
FLOWN_RGB: Final[Rgb] = (255, 196, 0)
VEHICLE_RGB: Final[Rgb] = (255, 64, 64)
FOOTPRINT_RGB: Final[Rgb] = (64, 224, 255)
CAMERA_RGB: Final[Rgb] = (170, 240, 255)
AREA_RGB: Final[Rgb] = (120, 190, 255)
FENCE_RGB: Final[Rgb] = (255, 128, 64)
HOME_RGB: Final[Rgb] = (255, 64, 192)
CEILING_RGB: Final[Rgb] = (255, 48, 72)
FLOOR_RGB: Final[Rgb] = (190, 120, 255)
LOST_RGB: Final[Rgb] = (255, 96, 64)
SEEN_RGB: Final[Rgb] = (46, 204, 113)
UNSEEN_RGB: Final[Rgb] = (118, 124, 140)
NOT_COVERABLE_RGB: Final[Rgb] = (86, 48, 92)


def log_static(recording: rr.RecordingStream, entity: str, *parts: rr.AsComponents) -> None:
    """Log static data.

    Single calls go through a batching thread and columns do not; without waiting for it here, two recordings of one
    flight would hold the same chunks in another order.
    """
    recording.log(entity, *parts, static=True)
    recording.flush()


def nanoseconds(time_s: ArrayLike) -> NDArray[np.timedelta64]:
    """Durations (n,) to the nearest nanosecond."""
    return np.rint(np.asarray(time_s, float) * 1e9).astype("timedelta64[ns]")


def time_column(time_s: ArrayLike) -> rr.TimeColumn:
    """Vehicle times (n,) in seconds on the timeline of recordings."""
    return rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))


def ui_points(size: float) -> rr.components.Radius:
    """A radius in screen points at any distance; rerun recognises it by its sign."""
    return rr.components.Radius(-size)


def any_values(values: Mapping[str, NDArray[Any]]) -> rr.AnyValues:
    """Components of our own, by name."""
    return rr.AnyValues(True, **values)


def any_value_columns(columns: Mapping[str, NDArray[Any]]) -> rr.ComponentColumnList:
    """Components of our own by name, each (n,) with one value in a row."""
    return rr.AnyValues.columns(True, **columns)


def open_stream(site: "Site", recording_id: str) -> rr.RecordingStream:
    """A stream for a recording of a scenario."""
    return rr.RecordingStream(application_id(site), recording_id=recording_id, send_properties=False)


def application_id(site: "Site") -> str:
    """The application id determines which blueprint the viewer applies, so each scenario has its own.

    Rerun takes ASCII letters, digits, spaces, "-", "_" and ":", and few of them; it would warn of any other name and change it.
    """
    name = site.scenario.name
    plain = _NOT_IN_ENTRY_NAMES.sub("-", name)[: SCENE.longest_name]
    return f"uavcover_{name if plain == name else f'{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}'}"


@contextlib.contextmanager
def strict_mode() -> Iterator[None]:
    """Inside the block, wrong calls of rerun raise instead of being logged."""
    before = rr.error_utils.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
