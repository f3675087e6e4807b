"""Good missions for trying ``uavcover check``, made without the package."""

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import Affine

from tests.naive.file_ground import FileGround
from tests.naive.mission_check import Plane, judge, path, shortest_time_s
from tests.terrain_kinds import KINDS as RELIEFS
from tests.terrain_kinds import LAT_DEG, LON_DEG, TRUE_TO_SCALE

JACKSBORO = Path(__file__).parents[3] / "uavcover" / "data" / "jacksboro.tif"
KINDS = ("hill", "no-fly", "spline", "jump", "frame", "feet", "swapped", "fence", "battery", "return")
LOW_M, HIGH_M = 20.0, 120.0
MARGIN_M = 1.0
SPEED_M_S = 8.0
CLIMB_M_S, DESCENT_M_S = 2.5, 1.5

Row = tuple[int, int, tuple[float, float, float, float], float, float, float]
NOTHING = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Terrain:
    """An elevation file, and where missions may be on it: latitudes and longitudes."""

    name: str
    file: Path
    ground: FileGround
    south_west: tuple[float, float]
    north_east: tuple[float, float]


def terrains(folder: Path) -> list[Terrain]:
    """The bundled terrain, and six made ones of 2.4 km."""
    found = [Terrain("jacksboro", JACKSBORO, FileGround(JACKSBORO), (36.47, -84.27), (36.52, -84.20))]
    for name, (relief, scale) in _MADE.items():
        file = folder / f"{name}.tif"
        _write(file, relief, scale)
        found.append(
            Terrain(
                name, file, FileGround(file), (LAT_DEG - 0.004, LON_DEG - 0.006), (LAT_DEG + 0.004, LON_DEG + 0.006)
            )
        )
    return found


_MADE = {
    "ridge": ("strip", 2.5), "rolling": ("narrow band", 2.5), "volcano": ("volcano", 1.2), "terraces": ("terraces", 1.4),
    "canyon": ("canyon", 1.0), "fractal": ("fractal", 1.6),
}  # fmt: skip
"""Reliefs of tests/terrain_kinds.py by name, and by how much they are steepened."""


def _write(file: Path, relief: str, scale: float) -> None:
    pixel_m, half_m = 5.0, 1200.0
    axis = np.arange(-half_m + pixel_m / 2.0, half_m, pixel_m)
    east, north = np.meshgrid(axis, axis[::-1])
    heights = RELIEFS[relief].relief(east, north)
    heights = heights.mean() + scale * (heights - heights.mean())
    transform = Affine(pixel_m, 0.0, -half_m, 0.0, -pixel_m, half_m)
    with rasterio.open(
        file, "w", driver="GTiff", width=len(axis), height=len(axis), count=1, dtype="float32", crs=TRUE_TO_SCALE,
        transform=transform,
    ) as out:  # fmt: skip
        out.write(heights.astype(np.float32), 1)


@dataclass(frozen=True, eq=False)
class Case:
    """A mission with what it is judged by.

    Attributes:
        terrain: where it is.
        home: latitude, longitude.
        rows: its items.
        px4: whether PX4 flies it (a .plan), or ArduPilot (a .waypoints).
        return_m: return altitude above home.
        battery_s: time in the air.
        fence: ring of (longitude, latitude).
        zone: ring, floor and ceiling above ground.
        truth: what the naive judge says; none where it cannot.
        expected: kinds of findings that name the fault.
        items: where the fault is.
        swap_home: whether the file has latitude and longitude of home swapped.
    """

    terrain: Terrain
    home: tuple[float, float]
    rows: tuple[Row, ...]
    px4: bool
    return_m: float
    battery_s: float
    fence: tuple[tuple[float, float], ...]
    zone: tuple[tuple[tuple[float, float], ...], float, float]
    truth: dict[str, dict[tuple[int, int], float]] | None = None
    expected: tuple[str, ...] = ()
    items: tuple[int, int] | None = None
    swap_home: bool = False

    def judged(self) -> "Case":
        """With what the naive judge says."""
        truth = judge(
            self.rows, self.home, self.terrain.ground, return_m=self.return_m, px4=self.px4, low_m=LOW_M, high_m=HIGH_M,
            fence=self.fence, zone=self.zone,
        )  # fmt: skip
        return dataclasses.replace(self, truth=truth)

    def worst(self, kind: str) -> float:
        """By how much a kind of limit is broken at most; negative where it is kept."""
        assert self.truth is not None
        return max(self.truth[kind].values(), default=-math.inf)

    @property
    def is_good(self) -> bool:
        """Whether every limit is kept by the margin, and the battery lasts for longer than any flight of this path."""
        assert self.truth is not None
        return all(self.worst(kind) < -MARGIN_M for kind in ("ground", "height", "fence", "return")) and all(
            self.worst(kind) < 0.0 for kind in ("no-fly", "return-fence", "return-no-fly")
        )

    def write(self, folder: Path) -> list[str]:
        """Write the files; the arguments of the command."""
        height = float(self.terrain.ground.height_m(np.array([self.home[0]]), np.array([self.home[1]]))[0])
        lat, lon = self.home[::-1] if self.swap_home else self.home
        file = folder / ("m.plan" if self.px4 else "m.waypoints")
        file.write_text(_plan(self.rows, (lat, lon, height)) if self.px4 else _waypoints(self.rows, (lat, lon, height)))
        fence, zone = folder / "fence.geojson", folder / "zone.geojson"
        fence.write_text(json.dumps(_feature(self.fence, {})))
        zone.write_text(json.dumps(_ed269(self.zone)))
        return [
            str(file), "--dem", str(self.terrain.file), "--fence", str(fence), "--no-fly", str(zone), "--min-height", f"{LOW_M}m",
            "--max-height", f"{HIGH_M}m", "--return-height", f"{self.return_m}m", "--battery", f"{self.battery_s}s",
            "--autopilot", "px4" if self.px4 else "ardupilot", "--speed", f"{SPEED_M_S}m/s",
        ]  # fmt: skip


def _waypoints(rows: tuple[Row, ...], home: tuple[float, float, float]) -> str:
    lines = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{home[0]:.8f}\t{home[1]:.8f}\t{home[2]:.3f}\t1"]
    for number, (command, frame, params, lat, lon, alt) in enumerate(rows, 1):
        numbers = "\t".join(f"{value:g}" for value in params)
        lines.append(f"{number}\t0\t{frame}\t{command}\t{numbers}\t{lat:.8f}\t{lon:.8f}\t{alt:.3f}\t1")
    return "\n".join(lines) + "\n"


def _plan(rows: tuple[Row, ...], home: tuple[float, float, float]) -> str:
    items = [
        {
            "type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": number, "frame": frame,
            "params": [*params, round(lat, 8), round(lon, 8), round(alt, 3)],
        }
        for number, (command, frame, params, lat, lon, alt) in enumerate(rows, 1)
    ]  # fmt: skip
    mission = {
        "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "items": items,
        "plannedHomePosition": list(home),
    }  # fmt: skip
    empty = {"version": 2, "circles": [], "polygons": []}
    parts = {"mission": mission, "geoFence": empty, "rallyPoints": {"version": 2, "points": []}}
    return json.dumps({"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", **parts})


def _feature(ring: tuple[tuple[float, float], ...], properties: dict[str, object]) -> dict[str, object]:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
    }


def _ed269(zone: tuple[tuple[tuple[float, float], ...], float, float]) -> dict[str, object]:
    ring, floor, ceiling = zone
    geometry = {
        "uomDimensions": "M", "lowerLimit": floor, "lowerVerticalReference": "AGL", "upperLimit": ceiling,
        "upperVerticalReference": "AGL",
        "horizontalProjection": {"type": "Polygon", "coordinates": [[*map(list, ring), list(ring[0])]]},
    }  # fmt: skip
    feature = {
        "identifier": "Z1", "country": "XXX", "name": "Z", "type": "COMMON", "restriction": "PROHIBITED", "reason": ["SENSITIVE"],
        "zoneAuthority": [], "applicability": [{"permanent": "YES"}], "geometry": [geometry],
    }  # fmt: skip
    return {"title": "zones", "features": [feature]}


def good_mission(terrain: Terrain, rng: np.random.Generator) -> Case | None:
    """Lines over a rectangle, with points wherever a leg would leave 32 to 108 m above the ground; none where that fails."""
    (south, west), (north, east) = terrain.south_west, terrain.north_east
    plane = Plane(rng.uniform(south, north), rng.uniform(west, east))
    width, depth, turn = rng.uniform(300.0, 650.0), rng.uniform(150.0, 400.0), rng.uniform(0.0, 2.0 * math.pi)
    across = np.array([math.cos(turn), math.sin(turn)])
    along = np.array([-across[1], across[0]])
    lines = int(rng.integers(3, 5))
    corners = [np.zeros(2) + 15.0 * across]
    for k in range(lines):
        ends = [along * (40.0 + k * depth / lines) + across * x for x in (15.0, width)]
        corners += ends if k % 2 == 0 else ends[::-1]
    ground = terrain.ground
    home = plane.back(0.0, 0.0)
    home_m = ground_height_m(ground, plane, np.zeros(2))
    if not math.isfinite(home_m):
        return None
    target = rng.uniform(42.0, 65.0)
    points = [np.array([0.0, 0.0, home_m + 60.0])]
    for corner in corners[1:]:
        points += _path(
            ground, plane, points[-1], np.array([*corner, ground_height_m(ground, plane, corner) + target]), target
        )
        if len(points) > 90:
            return None
    px4, above_home = bool(rng.random() < 0.4), bool(rng.random() < 0.7)
    returns = bool(rng.random() < 0.5)
    if not returns:
        points += _path(ground, plane, points[-1], points[0], target)
    frame, base = (3, home_m) if above_home else (0, 0.0)
    rows: list[Row] = [(22, 3, NOTHING, 0.0 if not px4 else home[0], 0.0 if not px4 else home[1], 60.0)]
    for point in points[1:]:
        hold = float(rng.integers(1, 4)) if rng.random() < 0.1 else 0.0
        rows.append((16, frame, (hold, 0.0, 0.0, 0.0), *plane.back(point[0], point[1]), float(point[2]) - base))
    rows.append((20, 2, NOTHING, 0.0, 0.0, 0.0) if returns else (21, 3, NOTHING, *home, 0.0))
    case = _with_limits(terrain, home, tuple(rows), px4=px4, rng=rng)
    if case is None:
        return None
    for change in (_splines, _repeats):
        changed = change(case, rng)
        if changed is not None and rng.random() < 0.4:
            again = _with_limits(terrain, home, changed, px4=px4, rng=rng)
            case = case if again is None else again
    return case


def ground_height_m(ground: FileGround, plane: Plane, en: np.ndarray) -> float:
    lat, lon = plane.back(en[0], en[1])
    return float(ground.height_m(np.array([lat]), np.array([lon]))[0])


def _path(
    ground: FileGround, plane: Plane, a: np.ndarray, b: np.ndarray, target: float, depth: int = 0
) -> list[np.ndarray]:
    """Points after a up to b, with more between them until every leg keeps a narrower band."""
    t = np.linspace(0.0, 1.0, max(3, math.ceil(float(np.hypot(*(b - a)[:2])) / 2.0)))
    line = a + t[:, None] * (b - a)
    above = line[:, 2] - ground.height_m(*plane.back(line[:, 0], line[:, 1]))
    if (above.min() >= 32.0 and above.max() <= 108.0) or depth == 5 or not np.isfinite(above).all():
        return [b]
    middle = (a + b) / 2.0
    middle[2] = ground_height_m(ground, plane, middle) + target
    return [*_path(ground, plane, a, middle, target, depth + 1), *_path(ground, plane, middle, b, target, depth + 1)]


def _with_limits(
    terrain: Terrain, home: tuple[float, float], rows: tuple[Row, ...], *, px4: bool, rng: np.random.Generator
) -> Case | None:
    plane = Plane(*home)
    ground = terrain.ground
    home_m = ground_height_m(ground, plane, np.zeros(2))
    flown = np.vstack([points for *_, points in path(rows, plane, home_m, 60.0, px4=px4)])
    box = (flown[:, :2].min(axis=0) - 25.0, flown[:, :2].max(axis=0) + 25.0)
    # Whatever is in the box is flown over with 30 m to spare on the way home.
    east, north = np.meshgrid(np.linspace(box[0][0], box[1][0], 120), np.linspace(box[0][1], box[1][1], 120))
    top_m = float(np.max(ground.height_m(*plane.back(east, north))))
    return_m = float(max(30.0, math.ceil(top_m - home_m + LOW_M + 8.0)))
    if not math.isfinite(return_m):
        return None
    fence = ring_of(
        plane, [(box[0][0], box[0][1]), (box[1][0], box[0][1]), (box[1][0], box[1][1]), (box[0][0], box[1][1])]
    )
    # A zone beside the route, or above it.
    if rng.random() < 0.5:
        x = box[1][0] + 30.0
        zone = (ring_of(plane, [(x, -50.0), (x + 80.0, -50.0), (x + 80.0, 60.0), (x, 60.0)]), 0.0, 500.0)
    else:
        x, y = flown[len(flown) // 2, :2]
        zone = (
            ring_of(plane, [(x - 40.0, y - 40.0), (x + 40.0, y - 40.0), (x + 40.0, y + 40.0), (x - 40.0, y + 40.0)]),
            HIGH_M + 2.0,
            500.0,
        )
        if rows[-1][0] == 20:
            zone = (zone[0], 900.0, 1500.0)  # a return is higher than the band
    least_s = least_time_s(rows, home, ground, return_m, px4=px4)
    battery_s = 1.25 * (1.6 * least_s + 9.0 * len(rows) + 120.0) / 0.8
    case = Case(terrain, home, rows, px4, return_m, round(battery_s), fence, zone).judged()
    return case if case.is_good else None


def least_time_s(
    rows: tuple[Row, ...], home: tuple[float, float], ground: FileGround, return_m: float, *, px4: bool
) -> float:
    climb, descent = (3.0, 1.5) if px4 else (CLIMB_M_S, DESCENT_M_S)
    return shortest_time_s(
        rows, home, ground, return_m=return_m, px4=px4, speed_m_s=SPEED_M_S, climb_m_s=climb, descent_m_s=descent
    )


def ring_of(plane: Plane, positions: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    return tuple((lon, lat) for lat, lon in (plane.back(x, y) for x, y in positions))


def _splines(case: Case, rng: np.random.Generator) -> tuple[Row, ...] | None:
    """Some waypoints as splines."""
    if case.px4:
        return None
    first = int(rng.integers(2, max(3, len(case.rows) - 3)))
    last = first + int(rng.integers(1, 4))
    return tuple(
        (82, *row[1:]) if row[0] == 16 and first <= n <= last and row[2][0] == 0.0 else row
        for n, row in enumerate(case.rows, 1)
    )


def _repeats(case: Case, rng: np.random.Generator) -> tuple[Row, ...] | None:
    """A part of the route flown again."""
    last = int(rng.integers(3, max(4, len(case.rows) - 1)))
    return (
        *case.rows[:last],
        (177, 2, (float(last - 1), float(rng.integers(1, 3)), 0.0, 0.0), 0.0, 0.0, 0.0),
        *case.rows[last:],
    )
