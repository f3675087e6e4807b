"""The recording of a fleet: all flights on one clock, the observed cells, and the separation of the vehicles."""

import hashlib
import itertools
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mission_io.model.plain_text import plain_text
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Route
from uavcover.recording import flight, layout
from uavcover.recording.blueprint import LEGEND_TEXT, make_blueprint
from uavcover.recording.layout import RecordingError, application_id, log_static, strict_mode, time_column, ui_points
from uavcover.recording.scene import log_scene
from uavcover.recording.tiles import lift_m
from uavcover.recording.tuning import SCENE
from uavcover.recording.writer import write_whole
from uavcover.sensing.coverage_map import CoverageMap

_NAMESPACE = uuid.UUID("1a0f3a7e-90c6-4c0b-8e7d-54d7a4a5b9c3")
_COLOURS: tuple[layout.Rgb, ...] = (
    layout.FLOWN_RGB, (96, 200, 255), (255, 120, 170), (150, 255, 120), (220, 160, 255), (255, 160, 90),
)  # fmt: skip


def record_fleet(
    path: Path,
    *,
    coverage: CoverageMap,
    planned: Route,
    tracks: Mapping[str, tuple[FloatArray, FloatArray]],
    first_seen_s: NDArray[np.float64],
) -> None:
    """Write all flights of a fleet as one recording for the rerun viewer; an existing file is replaced.

    Args:
        path: the file.
        coverage: the cells of the site.
        planned: the whole route.
        tracks: by name, (n,) increasing times on the clock that all share, and (n, 3) ENU positions.
        first_seen_s: (cells,) time on that clock at which each cell was seen first, NaN where it never was.

    Raises:
        RecordingError: there is no track.
        OutputError: the file cannot be written.
    """
    if not tracks:
        raise RecordingError("there is no track to record")
    site = coverage.site
    span_s = (min(float(t[0]) for t, _ in tracks.values()), max(float(t[-1]) for t, _ in tracks.values()))
    paths = [f"{layout.FLOWN}/{_entity(name)}" for name in tracks]
    with strict_mode():
        name = plain_text(f"{site.scenario.name}, {len(tracks)} flights")
        digest = hashlib.sha256(b"".join(t.tobytes() + p.tobytes() for t, p in tracks.values())).hexdigest()
        recording = rr.RecordingStream(
            application_id(site),
            recording_id=str(uuid.uuid5(_NAMESPACE, f"{name}{digest}")),
            send_properties=False,
        )
        memory = recording.memory_recording()
        recording.send_blueprint(make_blueprint(site, span_s=span_s, paths=paths), make_active=False, make_default=True)
        recording.send_recording_name(name)
        log_static(recording, layout.LEGEND, rr.TextDocument(LEGEND_TEXT, media_type="text/markdown"))
        log_scene(recording, site, planned, lift_m=2.0 * lift_m(coverage))
        flight.log_coverage(recording, coverage, span_s, first_seen_s)
        for number, (title, (time_s, enu_m)) in enumerate(tracks.items()):
            _log_flight(recording, coverage, title, time_s, enu_m, _COLOURS[number % len(_COLOURS)])
        data = memory.drain_as_bytes()
    write_whole(path, data)


def _entity(name: str) -> str:
    return name.replace(" ", "_").replace(",", "")


def _log_flight(
    recording: rr.RecordingStream,
    coverage: CoverageMap,
    name: str,
    time_s: FloatArray,
    enu_m: FloatArray,
    rgb: layout.Rgb,
) -> None:
    entity = _entity(name)
    path, place = f"{layout.FLOWN}/{entity}", f"{layout.VEHICLE}/{entity}"
    log_static(recording, path, rr.LineStrips3D.from_fields(colors=[rgb], radii=ui_points(2.5)))
    log_static(recording, place, rr.Points3D.from_fields(colors=[rgb], radii=ui_points(6.0), labels=[name]))
    recording.send_columns(place, [time_column(time_s)], rr.Points3D.columns(positions=enu_m))
    ends = _pieces(time_s)
    strips = [enu_m[a : b + 1] for a, b in itertools.pairwise(ends)]
    if strips:
        recording.send_columns(path, [time_column(time_s[ends[1:]])], rr.LineStrips3D.columns(strips=strips))
    series = f"{layout.SERIES}/height/{entity}"
    flight.name_series(recording, series, name=name, rgb=rgb)
    flight.send_series(recording, series, time_s, coverage.site.ground.heights_agl_m(enu_m))


def _pieces(time_s: FloatArray) -> Sequence[int]:
    """Samples at which the pieces of a path end."""
    step = np.floor((time_s - time_s[0]) / SCENE.piece_s)
    found = np.append(np.flatnonzero(np.diff(step, prepend=-1.0) > 0), time_s.size - 1)
    return [int(k) for k in np.unique(found)]
