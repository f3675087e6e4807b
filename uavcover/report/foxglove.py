"""A run as an MCAP file for Foxglove: positions, attitude, planned route, coverage; the package ``mcap`` is the extra ``mcap``.

Every message is JSON with a schema of its own in the file; those named ``foxglove.*`` have the fields that Foxglove's panels
know. The clock is that of the report: 0 at the start of the first flight, the others one after the other. Altitudes are above
sea level.
"""

import base64
import importlib.util
import io
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from mission_io.model.plain_text import plain_text, plain_values
from uavcover.errors import InputError, OutputError
from uavcover.judging.verify import Verdict
from uavcover.kernels.arrays import FloatArray
from uavcover.report.content import Flight, ReportContent, read_run
from uavcover.report.map_data import bounds_m
from uavcover.report.page import standing
from uavcover.run.file_group import write_file
from uavcover.run.folder import RunFolder
from uavcover.run.user import User
from uavcover.scenario.airspace.zone_lines import zone_lines_m
from uavcover.scenario.site import Site

FRAME: Final = "enu"
"""Of the local frame: metres east, north, up of the scenario's origin."""

NOT_SEEN, SEEN = 1, 2
"""Values of a cell in ``/coverage/grid``; 0 is outside the area."""

_TICKS = 60
_NO_FLY = (0.88, 0.14, 0.37)
_UINT8 = 1  # foxglove.NumericType
_LINE_STRIP = 0
_WARNING, _ERROR = 3, 4  # foxglove.Log

_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_NUMBER, _TEXT, _WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _array(of: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": of}


_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_LINE = _object(
    type=_WHOLE, pose=_POSE, thickness=_NUMBER, scale_invariant={"type": "boolean"}, points=_array(_VECTOR),
    color=_COLOR, colors=_array(_COLOR), indices=_array(_WHOLE),
)  # fmt: skip
_ENTITY = _object(
    timestamp=_TIME, frame_id=_TEXT, id=_TEXT, lifetime=_TIME, frame_locked={"type": "boolean"},
    metadata=_array(_object(key=_TEXT, value=_TEXT)), lines=_array(_LINE),
)  # fmt: skip
SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    "foxglove.LocationFix": _object(
        timestamp=_TIME, frame_id=_TEXT, latitude=_NUMBER, longitude=_NUMBER, altitude=_NUMBER,
        position_covariance=_array(_NUMBER), position_covariance_type=_WHOLE,
    ),
    "foxglove.PoseInFrame": _object(timestamp=_TIME, frame_id=_TEXT, pose=_POSE),
    "foxglove.FrameTransform": _object(
        timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_VECTOR, rotation=_QUATERNION
    ),
    "foxglove.SceneUpdate": _object(
        deletions=_array(_object(timestamp=_TIME, type=_WHOLE, id=_TEXT)), entities=_array(_ENTITY)
    ),
    "foxglove.GeoJSON": _object(geojson=_TEXT),
    "foxglove.Grid": _object(
        timestamp=_TIME, frame_id=_TEXT, pose=_POSE, column_count=_WHOLE, cell_size=_object(x=_NUMBER, y=_NUMBER),
        row_stride=_WHOLE, cell_stride=_WHOLE, fields=_array(_object(name=_TEXT, offset=_WHOLE, type=_WHOLE)),
        data={"type": "string", "contentEncoding": "base64"},
    ),
    "foxglove.Log": _object(timestamp=_TIME, level=_WHOLE, message=_TEXT, name=_TEXT, file=_TEXT, line=_WHOLE),
    "uavcover.VehicleState": _object(
        height_agl_m={"type": ["number", "null"]}, roll_deg={"type": ["number", "null"]},
        pitch_deg={"type": ["number", "null"]}, yaw_deg={"type": ["number", "null"]}, current_waypoint=_WHOLE,
    ),
    "uavcover.Coverage": _object(seen_percent=_NUMBER, seen_of_coverable_percent=_NUMBER),
}  # fmt: skip
"""JSON schemas by name."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message: the topic it belongs to, the name of its schema, its time, and its content."""

    topic: str
    schema: str
    time_ns: int
    content: dict[str, Any]


def export_mcap(run: RunFolder, path: Path, user: User, *, force: bool) -> int:
    """Write a run, judged as for its report, as an MCAP file; returns the number of messages.

    Raises:
        InputError: the package ``mcap`` is not installed, or a file of the run is missing or broken.
        OutputError: the file is there already and ``force`` was not said, or cannot be written.
    """
    if importlib.util.find_spec("mcap") is None:
        raise InputError("--format mcap: needs the package mcap; install it with: pip install 'uavcover[mcap]'")
    if path.exists() and not force:
        raise OutputError(f"{path}: would be overwritten; use --force, or another name")
    content = read_run(run, logs=(), notices=standing(run, ()))
    for warning in (*content.notices, *content.warnings):
        user.warn(warning)
    told = sorted(messages(content), key=lambda message: message.time_ns)
    write_file(path, packed(content, told))
    return len(told)


def packed(content: ReportContent, told: Sequence[Message]) -> bytes:
    """Messages in order of time, with their schemas, as the bytes of an MCAP file."""
    from mcap.writer import Writer

    out = io.BytesIO()
    writer = Writer(out)
    writer.start(profile="", library=f"uavcover {metadata.version('uavcover')}")
    schemas = {
        name: writer.register_schema(name=name, encoding="jsonschema", data=json.dumps(SCHEMAS[name]).encode())
        for name in dict.fromkeys(message.schema for message in told)
    }
    channels: dict[str, int] = {}
    for message in told:
        if message.topic not in channels:
            channels[message.topic] = writer.register_channel(
                topic=message.topic, message_encoding="json", schema_id=schemas[message.schema]
            )
        data = json.dumps(message.content, allow_nan=False).encode()
        writer.add_message(channels[message.topic], log_time=message.time_ns, publish_time=message.time_ns, data=data)
    verdict = content.verdict
    facts = {
        "scenario": content.site.scenario.name,
        "verdict": "not flown" if verdict is None else verdict.report.verdict,
    }
    writer.add_metadata(
        "uavcover",
        plain_values(facts) | {f"notice {k + 1}": plain_text(text) for k, text in enumerate(content.notices)},
    )
    writer.finish()
    return out.getvalue()


def messages(content: ReportContent) -> Iterator[Message]:
    """All messages of a run, topic by topic."""
    site, verdict = content.site, content.verdict
    yield Message("/planned/scene", "foxglove.SceneUpdate", 0, _scene(content))
    if site.frame is not None:
        yield Message("/planned/geojson", "foxglove.GeoJSON", 0, {"geojson": json.dumps(_geojson(content))})
    for number, flight in enumerate(content.flights):
        yield from _flight(site, flight, f"/flight_{number + 1}")
    if verdict is not None:
        start_s = float(content.flights[0].track.time_s[0])
        yield from _coverage(verdict, start_s, float(content.flights[-1].clock_s[-1]))
        yield from _pictures(site, verdict, start_s)
        for violation in verdict.report.violations:
            flight = content.flights[violation.track]
            at_s = float(np.interp(violation.start_s, flight.track.time_s, flight.clock_s))
            text = f"{violation.kind}: {violation.worst:.1f} against {violation.limit:g} {violation.unit}"
            yield _log(at_s, _ERROR, text)
        yield from (_log(0.0, _WARNING, line) for line in (*verdict.report.reasons, *verdict.report.doubts))


def _flight(site: Site, flight: Flight, topic: str) -> Iterator[Message]:
    track, child = flight.track, topic.strip("/")
    turned = orientations(track.attitude_deg, flight.enu_m)
    for k, clock_s in enumerate(flight.clock_s.tolist()):
        if not np.isfinite(flight.enu_m[k]).all():
            continue
        at = _nanoseconds(clock_s)
        position, rotation = _vector(flight.enu_m[k]), dict(zip("xyzw", turned[k].tolist(), strict=True))
        stamp = {"timestamp": _stamp(at)}
        yield Message(f"{topic}/transform", "foxglove.FrameTransform", at, stamp | {
            "parent_frame_id": FRAME, "child_frame_id": child, "translation": position, "rotation": rotation,
        })  # fmt: skip
        yield Message(f"{topic}/pose", "foxglove.PoseInFrame", at, stamp | {
            "frame_id": FRAME, "pose": {"position": position, "orientation": rotation},
        })  # fmt: skip
        if site.frame is not None:
            yield Message(f"{topic}/location", "foxglove.LocationFix", at, _fix(at, child, track.geodetic[k]))
        roll, pitch, yaw = (_known(angle) for angle in track.attitude_deg[k])
        yield Message(f"{topic}/state", "uavcover.VehicleState", at, {
            "height_agl_m": _known(flight.height_agl_m[k]), "roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw,
            "current_waypoint": int(track.current_waypoint[k]),
        })  # fmt: skip


def orientations(attitude_deg: FloatArray, enu_m: FloatArray) -> FloatArray:
    """(n, 4) quaternions x, y, z, w from a body of forward, left, up to east, north, up.

    Where an angle is not known, the vehicle is drawn level; without a yaw, nose ahead.

    Args:
        attitude_deg: (n, 3) roll, pitch, yaw of aviation: nose up is positive, yaw clockwise from north.
        enu_m: (n, 3) positions.
    """
    east, north = (np.gradient(enu_m[:, axis]) if len(enu_m) > 1 else np.zeros(len(enu_m)) for axis in (0, 1))
    ahead = np.arctan2(east, north)
    angles = np.where(
        np.isfinite(attitude_deg), np.radians(attitude_deg), np.column_stack([0.0 * ahead, 0.0 * ahead, ahead])
    )
    roll, pitch, yaw = 0.5 * angles[:, 0], 0.5 * angles[:, 1], 0.5 * (0.5 * math.pi - angles[:, 2])
    # About z by yaw, then about the left by minus pitch, then about the nose by roll.
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), -np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.column_stack([
        sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy
    ])  # fmt: skip


def _coverage(verdict: Verdict, start_s: float, end_s: float) -> Iterator[Message]:
    """What has been seen so far, as a flat grid below the ground and in percent, at some moments of the flight."""
    coverage, first_s = verdict.coverage, verdict.flown.first_seen_s - start_s
    cells, lowest_m = coverage.grid.cells, float(coverage.grid.cells.centre_m[:, 2].min())
    columns = cells.lattice.shape[1]
    inside, half = cells.lattice >= 0, 0.5 * cells.size_m
    for clock_s in np.linspace(0.0, end_s, _TICKS).tolist():
        at, seen = _nanoseconds(clock_s), first_s <= clock_s
        states = np.zeros(cells.lattice.shape, dtype=np.uint8)
        states[inside] = np.where(seen[cells.lattice[inside]], SEEN, NOT_SEEN)
        corner = {"x": cells.east0_m - half, "y": cells.north0_m - half, "z": lowest_m}
        yield Message("/coverage/grid", "foxglove.Grid", at, {
            "timestamp": _stamp(at), "frame_id": FRAME,
            "pose": {"position": corner, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
            "column_count": columns, "cell_size": {"x": cells.size_m, "y": cells.size_m},
            "row_stride": columns, "cell_stride": 1,
            "fields": [{"name": "state", "offset": 0, "type": _UINT8}],
            "data": base64.b64encode(states.tobytes()).decode(),
        })  # fmt: skip
        yield Message("/coverage/percent", "uavcover.Coverage", at, {
            "seen_percent": 100.0 * coverage.share(seen),
            "seen_of_coverable_percent": 100.0 * coverage.share_of_coverable(seen),
        })  # fmt: skip


def _pictures(site: Site, verdict: Verdict, start_s: float) -> Iterator[Message]:
    """Where single pictures were taken, for a camera that takes them."""
    if verdict.pictures is None or site.frame is None:
        return
    taken = verdict.observations.where(verdict.observations.known)
    geodetic = np.column_stack(site.frame.geodetic_from_enu(taken.places_m))
    for time_s, place in zip((taken.times_s - start_s).tolist(), geodetic, strict=True):
        at = _nanoseconds(time_s)
        yield Message("/pictures/location", "foxglove.LocationFix", at, _fix(at, FRAME, place))


def _scene(content: ReportContent) -> dict[str, Any]:
    """Planned route, area, fence and no-fly zones as lines; those of area and fence lie on the ground."""
    site = content.site
    lines = [("planned route", part.waypoints_m, (1.0, 1.0, 1.0)) for part in content.planned.route.parts]
    for name, shape, color in (("area", site.area, (0.5, 0.77, 1.0)), ("fence", site.fence, (1.0, 0.48, 0.35))):
        for part in shapely.get_parts(shape):
            for number, ring in enumerate((part.exterior, *part.interiors)):
                lines.append((f"{name} {number}", _on_ground(site, np.asarray(ring.coords)[:, :2]), color))
    for zone in site.zones:
        shown = zone_lines_m(site, zone, bounds_m(site))
        lines += [(f"no-fly zone {zone.name} {number}", line, _NO_FLY) for number, line in enumerate(shown)]
    stamp, still = _stamp(0), {"sec": 0, "nsec": 0}
    entities = [
        {
            "timestamp": stamp, "frame_id": FRAME, "id": f"{k}: {name}", "lifetime": still, "frame_locked": False,
            "metadata": [{"key": "name", "value": name}],
            "lines": [{
                "type": _LINE_STRIP, "pose": _still_pose(), "thickness": 2.0, "scale_invariant": True,
                "points": [_vector(point) for point in points], "color": dict(zip("rgba", (*rgb, 1.0), strict=True)),
                "colors": [], "indices": [],
            }],
        }
        for k, (name, points, rgb) in enumerate(lines)
    ]  # fmt: skip
    return {"deletions": [], "entities": entities}


def _on_ground(site: Site, ring_m: FloatArray) -> FloatArray:
    """A ring in short pieces on the ground; where there is no elevation, at the height of the lowest known."""
    places = np.asarray(shapely.LineString(ring_m).segmentize(20.0).coords)
    up = site.ground.heights_m(places)
    lowest = float(np.nanmin(up)) if np.isfinite(up).any() else 0.0
    return np.column_stack([places, np.where(np.isfinite(up), up, lowest)])


def _geojson(content: ReportContent) -> dict[str, Any]:
    site = content.site

    def degrees(points_m: FloatArray) -> list[list[float]]:
        if site.frame is None:
            return []
        lat, lon, _ = site.frame.geodetic_from_enu(np.column_stack([points_m[:, :2], np.zeros(len(points_m))]))
        return [[e, n] for e, n in zip(lon.tolist(), lat.tolist(), strict=True)]

    routes = content.planned.route.parts
    features = [("planned route", "LineString", degrees(part.waypoints_m), "#ffffff") for part in routes]
    for name, shape, color in (("area", site.area, "#7fc4ff"), ("fence", site.fence, "#ff7a59")):
        for part in shapely.get_parts(shape):
            for ring in (part.exterior, *part.interiors):
                features.append((name, "LineString", degrees(np.asarray(ring.coords)[:, :2]), color))
    for zone in site.zones:
        for part in shapely.get_parts(zone.outline):
            for ring in (part.exterior, *part.interiors):
                title = f"no-fly zone {zone.name}, {zone.heights_in_words()}"
                features.append((title, "LineString", degrees(np.asarray(ring.coords)[:, :2]), "#e0245e"))
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature", "properties": {"name": name, "style": {"color": color, "weight": 2}},
                "geometry": {"type": kind, "coordinates": coordinates},
            }
            for name, kind, coordinates, color in features
        ],
    }  # fmt: skip


def _fix(at: int, frame: str, place: FloatArray) -> dict[str, Any]:
    lat_deg, lon_deg, alt_amsl_m = place.tolist()
    return {
        "timestamp": _stamp(at), "frame_id": frame, "latitude": lat_deg, "longitude": lon_deg, "altitude": alt_amsl_m,
        "position_covariance": [0.0] * 9, "position_covariance_type": 0,
    }  # fmt: skip


def _log(clock_s: float, level: int, text: str) -> Message:
    at = _nanoseconds(clock_s)
    content = {
        "timestamp": _stamp(at),
        "level": level,
        "message": plain_text(text),
        "name": "uavcover verify",
        "file": "",
        "line": 0,
    }
    return Message("/verdict", "foxglove.Log", at, content)


def _still_pose() -> dict[str, Any]:
    return {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _vector(place: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", place.tolist(), strict=True))


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _nanoseconds(clock_s: float) -> int:
    return max(0, round(clock_s * 1e9))


def _stamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // 1_000_000_000, "nsec": time_ns % 1_000_000_000}
