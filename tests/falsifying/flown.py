"""An honest flight as a falsifier holds it: its columns, its plan, its ground; and its text as ``track.csv``."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import AGE_COLUMN, COLUMNS, PHOTOS_COLUMN, UNIX_TIME_COLUMN, VELOCITY_COLUMNS
from uavcover.run.documents import flown_tracks
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track
from uavcover.scenario.site import Site, load_site
from uavcover.verification.run_logs import read_planned_route


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight's record and what it was made with.

    Attributes:
        site: the scenario on its ground.
        plan_m: (k, 3) planned waypoints, ENU.
        time_s: (n,).
        geodetic: (n, 3) latitude, longitude, height above sea level.
        enu_m: (n, 3).
        attitude_deg: (n, 3) roll, pitch, yaw; NaN where it is not known.
        waypoint: (n,) numbers of planned waypoints, -1 off the route.
        attitude_age_s: (n,) time from the attitude to the place, NaN where it is not known; none: the record has no such column.
        photos_taken: (n,) the vehicle's count of photos, NaN where it is not known; none: it reported none.
        unix_time_s: (n,) seconds since 1970, where the record tells the date.
        velocity_ned_m_s: (n, 3) reported velocity, north, east, down, NaN where it is not known; none: it reported none.
        folder: of this flight inside the run folder.
        folders: of all flights of the run.
    """

    site: Site
    plan_m: FloatArray
    time_s: FloatArray
    geodetic: FloatArray
    enu_m: FloatArray
    attitude_deg: FloatArray
    waypoint: NDArray[np.int64]
    attitude_age_s: FloatArray | None = None
    photos_taken: FloatArray | None = None
    unix_time_s: FloatArray | None = None
    velocity_ned_m_s: FloatArray | None = None
    folder: Path = Path()
    folders: tuple[Path, ...] = (Path(),)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def on_route(self) -> BoolArray:
        """(n,) whether a sample lies between the first and the last planned waypoint."""
        return self.waypoint >= 1

    @property
    def step_s(self) -> float:
        """Usual time between two samples."""
        return float(np.median(np.diff(self.time_s)))

    def moment(self, fraction: float) -> float:
        """The time at which this share of the route's time is over; of the whole record where it knows no route."""
        times = self.time_s[self.on_route] if self.on_route.any() else self.time_s
        return float(times[0] + fraction * (times[-1] - times[0]))

    def between(self, begin_s: float, end_s: float) -> BoolArray:
        """(n,) which samples lie in a span of time."""
        return (self.time_s >= begin_s) & (self.time_s < end_s)

    def taken(self, keep: NDArray[np.int64] | BoolArray) -> "Flown":
        """Some of its samples, in any order."""
        return replace(
            self, time_s=self.time_s[keep], geodetic=self.geodetic[keep], enu_m=self.enu_m[keep],
            attitude_deg=self.attitude_deg[keep], waypoint=self.waypoint[keep],
            attitude_age_s=None if self.attitude_age_s is None else self.attitude_age_s[keep],
            unix_time_s=None if self.unix_time_s is None else self.unix_time_s[keep],
            photos_taken=None if self.photos_taken is None else self.photos_taken[keep],
            velocity_ned_m_s=None if self.velocity_ned_m_s is None else self.velocity_ned_m_s[keep],
        )  # fmt: skip

    def placed(self, enu_m: FloatArray) -> "Flown":
        """The same with other places, in both pairs of columns."""
        frame = self.site.frame
        assert frame is not None
        return replace(self, enu_m=enu_m, geodetic=np.column_stack(frame.geodetic_from_enu(enu_m)))

    def located(self, geodetic: FloatArray) -> "Flown":
        """The same with other latitudes, longitudes and heights, the local columns as they follow from them."""
        frame = self.site.frame
        assert frame is not None
        return replace(self, geodetic=geodetic, enu_m=frame.enu_from_geodetic(*geodetic.T))

    def held(self, source: NDArray[np.int64]) -> "Flown":
        """Each sample at the place of sample ``source[k]``, at its own time."""
        return replace(self, geodetic=self.geodetic[source], enu_m=self.enu_m[source])

    def text(self) -> str:
        """As ``track.csv``; an unknown attitude is an empty cell."""
        numbers = np.column_stack([self.time_s, self.geodetic, self.enu_m, self.attitude_deg])
        rows = [
            [*_cells(row), str(number)] for row, number in zip(numbers.tolist(), self.waypoint.tolist(), strict=True)
        ]
        header = list(COLUMNS)
        for name, column in (
            (AGE_COLUMN, self.attitude_age_s), (PHOTOS_COLUMN, self.photos_taken), (UNIX_TIME_COLUMN, self.unix_time_s),
            *([] if self.velocity_ned_m_s is None else zip(VELOCITY_COLUMNS, self.velocity_ned_m_s.T, strict=True)),
        ):  # fmt: skip
            if column is not None:
                header.append(name)
                rows = [[*row, *_cells([value])] for row, value in zip(rows, column.tolist(), strict=True)]
        return "".join(",".join(row) + "\n" for row in [header, *rows])


def _cells(values: list[float]) -> list[str]:
    return ["" if math.isnan(value) else repr(value) for value in values]


Change = Callable[[Flown], Flown]
"""One falsification, or a step of one; it may be given a record that is falsified already."""


def flights_in(run: Path) -> list[Path]:
    """The folders, inside a run folder, of the flights that count together; a single flight is the run folder itself.

    Raises:
        uavcover.errors.InputError: nothing was flown.
    """
    return [track.parent.relative_to(run) for track in flown_tracks(RunFolder(run))]


def read_flown(run: Path, flight: Path = Path()) -> Flown:
    """The flight in a run folder, or in the folder ``flight`` in it, of a sortie or of a flight that was gone on with.

    Raises:
        uavcover.errors.InputError: it has no scenario, plan or track that can be read.
    """
    folder = RunFolder(run / flight)
    site = load_site(folder.existing("scenario.toml", made_by="uavcover plan"))
    planned = read_planned_route(folder)
    track = read_track(folder.existing("track.csv", made_by="uavcover fly"))
    velocity = np.column_stack([getattr(track, name) for name in VELOCITY_COLUMNS])
    return Flown(
        site=site,
        plan_m=np.empty((0, 3)) if planned is None else planned.waypoints_m,
        time_s=track.time_s,
        geodetic=track.geodetic,
        enu_m=track.enu_m,
        attitude_deg=track.attitude_deg,
        waypoint=track.current_waypoint,
        attitude_age_s=track.attitude_age_s,
        photos_taken=track.pictures_taken if np.isfinite(track.pictures_taken).any() else None,
        velocity_ned_m_s=velocity if np.isfinite(velocity).any() else None,
        folder=flight,
        folders=tuple(flights_in(run)),
    )
