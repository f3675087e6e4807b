"""Terrains, areas, sensors and bands of heights that nobody chose, to try what a plan claims; see scripts/bench/random_cases.py.

Each number has a case of its own: the same one, whenever and wherever it is made.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from pyproj import Transformer

from tests.terrain_kinds import TRUE_TO_SCALE, Kind, Relief, fractal, write_kind
from uavcover.model.vehicle import AutopilotName

GROUNDS = ("fractal", "canyon", "volcano", "terraces", "rolling", "cliff", "ridge", "crater")
AREAS = ("box", "strip", "L", "C", "two parts", "triangle", "ring", "small")
SENSORS = ("nadir", "survey", "tilted", "sphere", "sphere along the path", "pictures", "sparse", "nadir at waypoints")

_STREAM, _BESIDE = 77, 78


@dataclass(frozen=True, slots=True)
class RandomCase:
    """What is planned.

    Attributes:
        number: from 0.
        ground: one of GROUNDS.
        area: one of AREAS.
        sensor: one of SENSORS.
        kind: all but the sensor.
        sensor_keys: of the scenario's table of it.
        required: share of what can be seen.
        fence_m: the fence is the hull of area and home, grown by this.
        zone: a no-fly zone's circle, east and north of the middle, radius and margin; none: no zone.
        autopilot: which.
        endurance_s: of a battery; none: it lasts.
    """

    number: int
    ground: str
    area: str
    sensor: str
    kind: Kind
    sensor_keys: str
    required: float
    fence_m: float
    zone: tuple[float, float, float, float] | None
    autopilot: AutopilotName
    endurance_s: float | None

    def write(self, folder: Path) -> Path:
        """Its files; the scenario's file."""
        vehicle = f'autopilot = "{self.autopilot}"\n'
        if self.endurance_s is not None:
            vehicle += f"endurance_s = {self.endurance_s:.0f}\n"
        return write_kind(
            folder, self.kind, name=f"random {self.number}", required=self.required, sensor=self.sensor_keys,
            limits=f"fence_margin_m = {self.fence_m:.1f}", vehicle=vehicle, more=self._zone(),
        )  # fmt: skip

    def _zone(self) -> str:
        if self.zone is None:
            return ""
        east, north, radius_m, margin_m = self.zone
        lon, lat = Transformer.from_crs(TRUE_TO_SCALE, 4326, always_xy=True).transform(east, north)
        return (
            f'\n[[no_fly]]\nname = "mast"\ncenter_lon_lat_deg = [{lon!r}, {lat!r}]\nradius_m = {radius_m:.1f}\n'
            f"margin_m = {margin_m:.1f}\n"
        )


def random_case(number: int) -> RandomCase:
    """The case of a number."""
    rng = np.random.default_rng([_STREAM, number])
    ground, area, sensor = (str(rng.choice(names)) for names in (GROUNDS, AREAS, SENSORS))
    shape = _area(area, rng)
    low_m, width_m = float(rng.uniform(35.0, 70.0)), float(rng.uniform(16.0, 90.0))
    kind = Kind(
        _relief(ground, rng),
        shape,
        cell_size_m=float(np.clip(math.sqrt(shape.area) / 80.0, 1.0, 6.0)),
        band_m=(low_m, low_m + width_m),
        margin_m=2.0 if width_m < 30.0 else float(rng.uniform(1.5, 5.0)),
        prisms=_prisms(shape, low_m, rng) if rng.random() < 0.35 else (),
    )
    sensor_keys, required = _sensor(sensor, rng), float(rng.choice([0.95, 0.98, 0.99]))
    beside = np.random.default_rng([_BESIDE, number])
    fence_m = float(beside.uniform(6.0, 30.0)) if beside.random() < 0.5 else 150.0
    zone = _zone(shape, beside) if beside.random() < 0.3 else None
    autopilot: AutopilotName = "px4" if beside.random() < 0.3 else "ardupilot"
    endurance_s = float(beside.uniform(300.0, 480.0)) if beside.random() < 0.25 else None
    kind = replace(kind, prisms=_some_towers(kind, beside))
    return RandomCase(
        number, ground, area, sensor, kind, sensor_keys, required, fence_m, zone, autopilot, endurance_s
    )  # fmt: skip


def _relief(name: str, rng: np.random.Generator) -> Relief:
    turn = rng.uniform(0.0, 2.0 * np.pi)
    a, b, c, d = rng.uniform(0.6, 1.6, 4)
    rough = fractal(int(rng.integers(1, 10**6)), float(rng.uniform(0.05, 0.5)))
    steep = fractal(int(rng.integers(1, 10**6)), float(rng.uniform(0.6, 1.6)))

    def heights(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        x, y = np.cos(turn) * east + np.sin(turn) * north, np.cos(turn) * north - np.sin(turn) * east
        away = np.hypot(x, y)
        shapes = {
            "fractal": lambda: steep(east, north),
            "canyon": lambda: (
                300.0
                + 0.3 * rough(east, north)
                + np.where(np.abs(y - 50.0 * a * np.sin(x / (90.0 * b))) < 35.0 * c, 0.0, 85.0 * d)
            ),
            "volcano": lambda: 400.0 + 0.3 * rough(east, north) + np.maximum(0.0, 170.0 * a - 0.6 * b * away),
            "terraces": lambda: 14.0 * a * np.floor((600.0 + 0.35 * b * y) / (14.0 * a)),
            "rolling": lambda: 250.0 + rough(east, north) + 22.0 * a * np.sin(x / (70.0 * b)) * np.cos(y / (55.0 * c)),
            "cliff": lambda: 100.0 + rough(east, north) + np.where(y > 20.0 * np.sin(x / 40.0), 70.0 * a, 0.0),
            "ridge": lambda: (
                500.0 + rough(east, north) + 80.0 * a * np.exp(-(((y - 30.0 * np.sin(x / 200.0)) / (50.0 * b)) ** 2))
            ),
            "crater": lambda: 300.0 + 0.2 * rough(east, north) - np.where(away < 80.0 * b, 60.0 * a, 0.0),
        }
        return np.asarray(shapes[name]())

    return heights


def _area(name: str, rng: np.random.Generator) -> shapely.Geometry:
    w, h, long_m, side_m = [*rng.uniform(200.0, 520.0, 2).tolist(), rng.uniform(500.0, 1300.0), rng.uniform(30.0, 90.0)]
    thin, gap_m, tip_m = rng.uniform(16.0, 30.0), rng.uniform(20.0, 120.0), rng.uniform(-100.0, 100.0)
    box = shapely.box(-w / 2, -h / 2, w / 2, h / 2)
    shapes = {
        "box": box,
        "strip": shapely.box(-long_m / 2, -long_m / thin, long_m / 2, long_m / thin),
        "L": box.difference(shapely.box(-w / 8, -h / 8, w, h)),
        "C": box.difference(shapely.box(-w / 6, -h / 5, w, h / 5)),
        "two parts": shapely.MultiPolygon(
            [shapely.box(-w, -h / 3, -50.0, h / 3), shapely.box(gap_m, -h / 2, 0.9 * w, h / 4)]
        ),
        "triangle": shapely.Polygon([(-w / 2, -h / 2), (w / 2, -h / 3), (tip_m, h / 2)]),
        "ring": box.difference(shapely.Point(0.0, 0.0).buffer(min(w, h) / 5, 8)),
        "small": shapely.box(-side_m / 2, -side_m / 3, side_m / 2, side_m / 3),
    }
    return shapely.affinity.rotate(shapes[name], float(rng.uniform(-45.0, 45.0)), origin=(0.0, 0.0))


def _prisms(
    area: shapely.Geometry, low_m: float, rng: np.random.Generator
) -> tuple[tuple[shapely.Polygon, float], ...]:
    west, south, east, north = area.bounds
    prisms = []
    for _ in range(8):
        x, y = rng.uniform(west, east), rng.uniform(south, north)
        house = shapely.box(x, y, x + rng.uniform(10.0, 40.0), y + rng.uniform(10.0, 40.0))
        prisms.append((shapely.affinity.rotate(house, rng.uniform(-30.0, 30.0)), float(rng.uniform(8.0, low_m))))
    return tuple(prisms)


def _some_towers(kind: Kind, rng: np.random.Generator) -> tuple[tuple[shapely.Polygon, float], ...]:
    """The houses, some of them so high that lines have to go around."""
    low_m, high_m = kind.band_m
    higher_m = rng.uniform(low_m, 1.3 * high_m, len(kind.prisms))
    is_tower = rng.random(len(kind.prisms)) < 0.4
    return tuple(
        (house, float(tower_m) if tower else height_m)
        for (house, height_m), tower_m, tower in zip(kind.prisms, higher_m, is_tower, strict=True)
    )


def _zone(area: shapely.Geometry, rng: np.random.Generator) -> tuple[float, float, float, float]:
    west, south, east, north = area.bounds
    margin_m = float(rng.uniform(2.0, 8.0))
    # Not where home is, which is 60 m west and 30 m south of all.
    return (
        float(rng.uniform(west + 30.0, east)),
        float(rng.uniform(south + 30.0, north)),
        float(rng.uniform(8.0, 30.0)),
        margin_m,
    )


def _sensor(name: str, rng: np.random.Generator) -> str:
    across, along, fov = rng.uniform(45.0, 85.0), rng.uniform(35.0, 65.0), rng.uniform(50.0, 95.0)
    range_m, incidence, heading = rng.uniform(90.0, 180.0), rng.uniform(65.0, 88.0), rng.uniform(0.0, 360.0)
    forward, side, pitch, trigger_m = (
        rng.uniform(0.5, 0.85), rng.uniform(0.3, 0.7), rng.uniform(40.0, 75.0), rng.uniform(15.0, 45.0),
    )  # fmt: skip
    frame = (
        f'kind = "frame-camera"\nfov_across_deg = {across:.1f}\nfov_along_deg = {along:.1f}\nrange_m = 250.0\n'
        'mount = "stabilised"\n'
    )
    nadir = f'kind = "nadir-camera"\nfov_deg = {fov:.1f}\nmax_incidence_deg = {incidence:.0f}\nmount = "stabilised"\n'
    sphere = f'kind = "sphere"\nrange_m = {range_m:.0f}\n'
    return {
        "nadir": nadir + "range_m = 220.0",
        "nadir at waypoints": nadir + 'range_m = 220.0\nsensing = "at-waypoints"',
        "survey": frame + f"forward_overlap = {forward:.2f}\nside_overlap = {side:.2f}",
        "tilted": frame + f"pitch_deg = -{pitch:.0f}\nmax_incidence_deg = 82.0",
        "pictures": frame + f'sensing = "at-waypoints"\nheading_deg = {heading:.0f}',
        "sparse": frame + f"trigger_distance_m = {trigger_m:.0f}",
        "sphere": sphere + 'sensing = "at-waypoints"',
        "sphere along the path": sphere + 'sensing = "along-path"',
    }[name]
