"""Close-enough travelling salesman: discs observed from waypoints by a tour through home, beside the best known tours.

The instances (Mennell 2009) are those that github.com/d-krupke/close-enough-tsp holds as ``benchmark.json.gz``; the best known
tours are those of github.com/leizy1008/MA-CETSP, in ``solutions``, and the upper bounds that the instances state. A disc may be
observed from anywhere on a tour, here only from its waypoints: that is never easier, so each tour is one of the published
problem.
"""

import functools
import gzip
import json
import math
import re
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import InputError
from uavcover.extras.benchmarks.areas import (
    LAT_DEG,
    LON_DEG,
    earth_from_metres,
    flat_site,
    home_en_m,
    planned,
)
from uavcover.extras.benchmarks.runs import KeptRuns, kept
from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.site import Site

_RADIUS_M, _PIXELS = 50.0, 60
_SHARED = 1e-3
"""Of a radius: published positions have five digits."""


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """Discs of one radius."""

    name: str  # of the instance
    home: FloatArray  # (2,) where the tour begins and ends
    centres: FloatArray  # (n, 2) of the discs
    radius: float  # of all discs
    best_known: float  # length of the best known tour

    def __str__(self) -> str:
        return self.name

    def unobserved(self, positions: FloatArray) -> int:
        """Discs that none of (m, 2) positions lies in."""
        apart = [float(np.hypot(*(positions - centre).T).min()) for centre in self.centres]
        return int((np.array(apart) > self.radius * (1.0 + 1e-9)).sum())


def tour_length(positions: FloatArray) -> float:
    """Length of the closed tour through (m, 2) positions."""
    return float(np.hypot(*(positions - np.roll(positions, 1, axis=0)).T).sum())


def read_instances(data: Path) -> dict[str, Instance]:
    """The instances of one radius below a folder, by name, whose best known tour is of the same discs.

    Raises:
        InputError: there is none, or a file cannot be read.
    """
    files = sorted(data.rglob("benchmark.json.gz"))
    tours = {path.stem: path for path in data.rglob("solutions/*/*.txt")}
    if not files or not tours:
        what = "benchmark.json.gz (d-krupke/close-enough-tsp)" if not files else "solutions/*/*.txt (MA-CETSP)"
        raise InputError(f"{data}: {what} not found; specify a folder with copies of both repositories")
    try:
        documents: Mapping[str, Mapping[str, Any]] = json.loads(gzip.decompress(files[0].read_bytes()))
        found = [_instance(name, documents[name]) for name in documents]
    except (OSError, EOFError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{files[0]}: cannot read the file ({error!r}); copy the file again") from error
    known = {each.name: each for each in found if each is not None and each.name in tours}
    return {name: each for name in sorted(known) if (each := _with_tour(known[name], tours[name])) is not None}


def _instance(name: str, document: Mapping[str, Any]) -> Instance | None:
    """An instance as its document has it; None where its radii differ."""
    disks = document["disks"]
    positions = np.array([[disk["x"], disk["y"]] for disk in disks], dtype=float)
    depot = [disk.get("meta") for disk in disks].index("depot")
    radii = {float(disk["r"]) for number, disk in enumerate(disks) if number != depot}
    ratio = re.fullmatch(r"(.*)\(0\.(\d+)\)", name)
    if len(radii) != 1:
        return None
    radius = radii.pop()
    if ratio is not None:
        # The radii of these are not those of the overlap ratio in their name, as the file's own history says.
        name = f"{ratio[1]}_or{float('0.' + ratio[2]) * 100.0:g}"
        radius = float("0." + ratio[2]) * float(np.ptp(positions, axis=0).max())
    bound = float(document["carrabs2020_upper_bound"])
    return Instance(name, positions[depot], np.delete(positions, depot, axis=0), radius, bound)


def _with_tour(instance: Instance, path: Path) -> Instance | None:
    """The instance with the better of its two best known lengths; None where the tour is one of other discs."""
    try:
        first, _, *rows = path.read_text(encoding="utf-8").strip().splitlines()
        stated = float(first.split(":")[1])
        visited = np.array([row.split() for row in rows], dtype=float).reshape(-1, 3)
    except (OSError, ValueError, IndexError) as error:
        raise InputError(f"{path}: cannot read the file ({error}); copy the file again") from error
    tour = visited[:, 1:]
    ends = np.roll(tour, -1, axis=0)
    apart = np.array([_from_legs(tour, ends, centre) for centre in instance.centres])
    same = visited[:, 0].max() <= len(instance.centres) and abs(tour_length(tour) - stated) <= _SHARED * stated
    if not same or apart.max() > instance.radius * (1.0 + _SHARED):
        return None
    return replace(instance, best_known=min(stated, instance.best_known))


def _from_legs(begins: FloatArray, ends: FloatArray, position: FloatArray) -> float:
    """Distance of a place from the nearest of the straight lines between (m, 2) positions."""
    along = ends - begins
    fraction = ((position - begins) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
    return float(np.hypot(*(begins + np.clip(fraction, 0.0, 1.0)[:, None] * along - position).T).min())


def site_of(instance: Instance, folder: Path) -> Site:
    """The site of an instance on flat ground: a radius is 50 m, the depot is home, and each disc's centre is to be observed."""
    metres = _RADIUS_M / instance.radius
    moved = (instance.centres - instance.home) * metres
    (west, south), (east, north) = np.minimum(moved.min(axis=0), 0.0), np.maximum(moved.max(axis=0), 0.0)
    around = 0.1 * max(east - west, north - south) + 10.0 * _RADIUS_M
    pixel = (max(east - west, north - south) + 2.0 * around) / _PIXELS
    to_earth = earth_from_metres()
    left, bottom, right, top = west - 1.0, south - 1.0, east + 1.0, north + 1.0
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    tables: dict[str, Any] = {
        "name": instance.name,
        "select": "coverage>=1.0",
        "area": {
            "polygon_lon_lat_deg": [list(map(float, to_earth.transform(*corner))) for corner in corners],
            "cell_size_m": 50.0,
        },
        "home": {"lat_deg": LAT_DEG, "lon_deg": LON_DEG},
        "sensor": {"kind": "disc", "radius_m": _RADIUS_M},
        "limits": {"applies_to": "waypoints", "fence_margin_m": 100.0},
        "planner": {
            "algorithm": "local-search", "encoding": "waypoints", "order": "nearest-neighbour",
            "max_waypoints": len(moved) + 10, "cell_size_m": 50.0,
        },
    }  # fmt: skip
    corner_m = (west - around, south - around)
    site = flat_site(folder, tables, corner_m=corner_m, shape=(_PIXELS, _PIXELS), pixel_m=pixel)
    # Turns take no time, so that the mission time grows with the length of the tour.
    vehicle = replace(site.scenario.vehicle, acceleration_m_s2=math.inf)
    return replace(site, targets_m=moved + home_en_m(site), scenario=replace(site.scenario, vehicle=vehicle))


def _run(instance: Instance, *, budget_s: float) -> dict[str, Any]:
    """Plan an instance: the length of the tour and the number of discs that it does not observe."""
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        site = site_of(instance, Path(scratch))
        plan = planned(site, instance.name, budget_s)
    positions = (plan.chosen.route.waypoints_m[:, :2] - home_en_m(site)) * (instance.radius / _RADIUS_M) + instance.home
    return {
        "discs": len(instance.centres), "length": tour_length(np.vstack([instance.home, positions])),
        "best_known": instance.best_known, "unseen": instance.unobserved(positions), "waypoints": len(positions),
        "cpu_s": time.process_time() - begin,
    }  # fmt: skip


def plan_instances(
    folder: KeptRuns, instances: Sequence[Instance], *, budget_s: float, processes: int
) -> Iterator[Instance]:
    """Plan instances in parallel; each that is done."""
    return kept(folder, functools.partial(_run, budget_s=budget_s), instances, processes=processes)


def table_lines(folder: KeptRuns) -> list[str]:
    """The instances that are done as CSV."""
    lines = ["instance,discs,length,best_known,ratio,unseen,waypoints,cpu_s"]
    for name in folder.done():
        row = folder.read(name)
        lines.append(
            f"{name},{row['discs']},{row['length']:.4f},{row['best_known']:.4f},"
            f"{row['length'] / row['best_known']:.4f},{row['unseen']},{row['waypoints']},{row['cpu_s']:.1f}"
        )
    return lines


def summary(folder: KeptRuns) -> str:
    """One line: how the lengths compare."""
    rows = [folder.read(name) for name in folder.done()]
    ratios = np.array([row["length"] / row["best_known"] if row["unseen"] == 0 else math.inf for row in rows])
    return (
        f"{len(rows)} instances: {int((ratios <= 1.01).sum())} within 1 % of the best known tour; ratio {ratios.min():.4f} "
        f"to {ratios.max():.4f}, median {np.median(ratios):.4f}; {sum(row['unseen'] > 0 for row in rows)} with unseen discs"
    )
