"""Other files of the run folder than the track, changed after planning or after the flight."""

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tests.falsifying.flown import Flown
from tests.falsifying.of_position import shifted
from tests.falsifying.way import Meddle, Way, family
from uavcover.model.area import RasterTerrain
from uavcover.scenario.scenario_file import dump_scenario, terrain_source
from uavcover.verification.gaps import Band, geotiff

CHANGED = "what is judged is not what was planned and flown"


def scenario_with(key: str, value: str) -> Meddle:
    """One value of ``scenario.toml`` replaced by another."""

    def meddle(run: Path) -> None:
        path = run / "scenario.toml"
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", path.read_text())
        if count != 1:
            raise ValueError(f"{path}: {key} stands in it {count} times")
        path.write_text(text)

    return meddle


def document_with(name: str, change: Callable[[Any], Any]) -> Meddle:
    """A JSON file changed."""

    def meddle(run: Path) -> None:
        document = json.loads((run / name).read_text())
        (run / name).write_text(json.dumps(change(document)))

    return meddle


@family("scenario changed")
def scenario(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Looser requirements, limits or sensors than were planned with."""
    text = _scenario_text(flown)
    loosened = {
        "min_coverage_of_coverable": "0.05", "max_gap_s": "3600.0", "min_height_agl_m": "1.0", "max_height_agl_m": "500.0",
        "transit_clearance_m": "0.5", "fence_margin_m": "5000.0", "cell_size_m": "33.0", "fov_deg": "120.0",
        "fov_across_deg": "120.0", "range_m": "2000.0", "max_incidence_deg": "89.0", "mount": '"stabilised"',
        "acceptance_radius_m": "60.0", "cruise_speed_m_s": "60.0", "max_climb_m_s": "40.0", "max_descent_m_s": "40.0",
        "max_home_error_m": "500.0", "clearance_beside_m": "0.01", "clearance_above_m": "0.01", "position_m": "0.0001",
        "sample_spacing_m": "1.0", "from_deg": "77.0", "name": '"another"',
    }  # fmt: skip
    for key, value in loosened.items():
        was = re.findall(rf"(?m)^{key} = (.*)$", text)
        if len(was) == 1 and was[0] != value:
            yield Way(f"{key} = {value}", CHANGED, meddle=scenario_with(key, value))
    yield Way("wind of 40 m/s", CHANGED, meddle=scenario_with("speed_m_s", "40.0"))
    yield Way("a space more", "the file is not what was planned with", meddle=_appended("scenario.toml", "\n# \n"))
    yield Way("removed", "there is nothing to judge by", meddle=lambda run: (run / "scenario.toml").unlink())
    yield Way("a smaller area", CHANGED, meddle=_smaller_area)


def _scenario_text(flown: Flown) -> str:
    return dump_scenario(flown.site.scenario)


def _appended(name: str, text: str) -> Meddle:
    def meddle(run: Path) -> None:
        with (run / name).open("a") as file:
            file.write(text)

    return meddle


def _written(name: str, text: str) -> Meddle:
    def meddle(run: Path) -> None:
        (run / name).write_text(text)

    return meddle


def _smaller_area(run: Path) -> None:
    path = run / "scenario.toml"
    document = tomllib.loads(path.read_text())
    [key] = [key for key in document["area"] if key.startswith("polygon_")]
    ring = np.array(document["area"][key])
    document["area"][key] = (ring.mean(axis=0) + 0.3 * (ring - ring.mean(axis=0))).tolist()
    path.write_text(tomli_w.dumps(document))


@family("ground changed")
def ground(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Another ground under the same flight."""
    terrain = re.findall(r'(?m)^file = "(.*)"$', _scenario_text(flown))
    if len(terrain) != 1:
        return
    yield Way("flattened", CHANGED, meddle=lambda run: _other_ground(run, flown, 0.0, 0.0))
    for by_m in (-40.0, 15.0):
        yield Way(f"{by_m:+g} m", CHANGED, meddle=lambda run, by_m=by_m: _other_ground(run, flown, 1.0, by_m))
    yield Way("smoother", CHANGED, meddle=lambda run: _other_ground(run, flown, 0.7, 0.0))
    if not terrain[0].startswith("bundled:"):
        yield Way("its file exchanged", CHANGED, meddle=lambda _: _exchanged_ground(flown))
        yield Way("its file gone", CHANGED, meddle=lambda _: _ground_gone(flown))


def _other_ground(run: Path, flown: Flown, fraction: float, by_m: float) -> None:
    """Another file for the ground; see :func:`_ground_file`."""
    (run / "ground.tif").write_bytes(_ground_file(flown, fraction, by_m))
    scenario_with("file", '"ground.tif"')(run)


def _exchanged_ground(flown: Flown) -> Callable[[], object]:
    """Another content under the name that the scenario knows, which stays as it was."""
    path = _named_file(flown)
    before = path.read_bytes()
    path.write_bytes(_ground_file(flown, 0.8, 0.0))
    return lambda: path.write_bytes(before)


def _ground_gone(flown: Flown) -> Callable[[], object]:
    path = _named_file(flown)
    away = path.rename(path.with_suffix(".away"))
    return lambda: away.rename(path)


def _ground_file(flown: Flown, fraction: float, by_m: float) -> bytes:
    """The scenario's ground with its heights against home times ``fraction`` plus ``by_m``."""
    site = flown.site
    assert site.frame is not None
    low = flown.enu_m.min(axis=0) - 1200.0
    high = flown.enu_m.max(axis=0) + 1200.0
    step_m = 20.0
    east, north = np.arange(low[0], high[0], step_m), np.arange(low[1], high[1], step_m)
    positions = np.stack(np.meshgrid(east, north), axis=-1).reshape(-1, 2)
    ups = site.ground.heights_m(positions).reshape(len(north), len(east))
    _, _, alts = site.frame.geodetic_from_enu(np.column_stack([positions, fraction * ups.reshape(-1) + by_m]))
    return geotiff(
        site.frame, [Band("height", "m", alts.reshape(ups.shape))], east0_m=float(east[0]), north0_m=float(north[0]),
        up_m=0.0, step_m=step_m,
    )  # fmt: skip


def _named_file(flown: Flown) -> Path:
    """The file of the ground, outside the copy that is judged."""
    terrain = flown.site.scenario.terrain
    assert isinstance(terrain, RasterTerrain)
    return terrain_source(terrain).files[0]


@family("plan changed")
def plan(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Another plan under the same flight, or with it."""
    if not len(flown.plan_m):
        return

    def waypoints(change: Callable[[list[Any]], list[Any]]) -> Meddle:
        return document_with("plan.json", lambda d: {**d, "waypoints": change(d["waypoints"])})

    yield Way("waypoints left out", CHANGED, meddle=waypoints(lambda w: w[: max(2, len(w) // 2)]))
    yield Way("waypoints backwards", CHANGED, meddle=waypoints(lambda w: w[::-1]))
    yield Way(
        "waypoints 20 m higher", CHANGED,
        meddle=waypoints(lambda w: [{**p, "up_m": p["up_m"] + 20.0, "alt_amsl_m": p["alt_amsl_m"] + 20.0} for p in w]),
    )  # fmt: skip
    yield Way(
        "promises less", CHANGED,
        meddle=document_with("plan.json", lambda d: {**d, "metrics": {**d["metrics"], "coverage_fraction": 0.1}}),
    )  # fmt: skip
    yield Way("moved by 400 m, and the flight with it", CHANGED, shifted((400.0, 0.0, 0.0)), meddle=waypoints(
        lambda w: [{**p, "east_m": p["east_m"] + 400.0} for p in w]))  # fmt: skip
    yield Way("without waypoints", CHANGED, meddle=waypoints(lambda _: []))
    yield Way("cut off", CHANGED, meddle=lambda run: _cut(run / "plan.json"))
    yield Way("removed", CHANGED, meddle=lambda run: (run / "plan.json").unlink())


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@family("obstacles changed")
def obstacles(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Fewer or lower obstacles than were planned with."""
    if not flown.site.scenario.obstacles.prisms:
        return
    yield Way("emptied", CHANGED, meddle=_no_obstacles)
    yield Way("a metre high", CHANGED, meddle=_low_obstacles)


def _no_obstacles(run: Path) -> None:
    path = run / "scenario.toml"
    head, *prisms = re.split(r"(?m)^(?=\[\[obstacles\.prisms\]\])", path.read_text())
    rest = re.split(r"(?m)^(?=\[(?!\[obstacles\.prisms))", prisms[-1])[1:]
    path.write_text(head + "".join(rest))


def _low_obstacles(run: Path) -> None:
    path = run / "scenario.toml"
    path.write_text(re.sub(r"(?m)^height_m = [\d.]+$", "height_m = 1.0", path.read_text()))


@family("run.json changed")
def run_json(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """What says which inputs belong together."""
    unbound = "nothing says any more that track, plan, ground and scenario belong together"

    def inputs(change: Callable[[Any], Any]) -> Meddle:
        return document_with("run.json", lambda d: {**d, "inputs": change(d["inputs"])})

    yield Way("removed", unbound, meddle=lambda run: (run / "run.json").unlink())
    yield Way("empty", unbound, meddle=_written("run.json", ""))
    yield Way("cut off", unbound, meddle=lambda run: _cut(run / "run.json"))
    yield Way("a list", unbound, meddle=_written("run.json", "[]"))
    yield Way(
        "without inputs",
        unbound,
        meddle=document_with("run.json", lambda d: {k: v for k, v in d.items() if k != "inputs"}),
    )
    yield Way("inputs empty", unbound, meddle=inputs(lambda _: {}))
    for name in ("scenario", "terrain"):
        yield Way(
            f"another hash of the {name}",
            unbound,
            meddle=inputs(lambda i, n=name: {**i, n: {**i[n], "sha256": "0" * 64}}),
        )
        yield Way(
            f"no hash of the {name}", unbound, meddle=inputs(lambda i, n=name: {k: v for k, v in i.items() if k != n})
        )
    yield Way("hash of a number", unbound, meddle=inputs(lambda i: {**i, "scenario": {"sha256": 7}}))


@family("flight's files changed")
def flight_files(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """The track gone, or a folder put together from two."""
    here = flown.folder
    yield Way("track.csv removed", "nothing was flown", meddle=lambda run: (run / here / "track.csv").unlink())
    yield Way("track.csv a folder", "nothing was flown", meddle=lambda run: _a_folder(run / here))
    if len(flown.folders) == 1:
        return
    first, *_, last = flown.folders
    several = "one of the flights is missing, or another's"
    yield Way("the last flight's track removed", several, meddle=lambda run: (run / last / "track.csv").unlink())
    yield Way("the first flight's track for the last", several, meddle=lambda run: _copied(
        run / first / "track.csv", run / last / "track.csv"))  # fmt: skip
    yield Way("the last flight's track for the first", several, meddle=lambda run: _copied(
        run / last / "track.csv", run / first / "track.csv"))  # fmt: skip
    yield Way("the last flight's folder removed", several, meddle=lambda run: shutil.rmtree(run / last))
    if last.name.startswith("sortie"):
        yield Way("the plan of a sortie emptied", CHANGED, meddle=document_with(
            f"{last}/plan.json", lambda d: {**d, "waypoints": d["waypoints"][:1]}))  # fmt: skip
        yield Way("the plan of a sortie removed", CHANGED, meddle=lambda run: (run / last / "plan.json").unlink())
    else:
        yield Way("gone on with another flight", several, meddle=document_with(
            f"{last}/run.json", lambda d: {k: v for k, v in d.items() if k != "resumes"}))  # fmt: skip


def _a_folder(flight: Path) -> None:
    (flight / "track.csv").unlink()
    (flight / "track.csv").mkdir()


def _copied(source: Path, target: Path) -> None:
    target.unlink()
    shutil.copy(source, target)
