"""Whatever changes between planning and the verdict is named, for every file and every kind of change; nothing else is."""

import dataclasses
import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest
import rasterio
from pyproj import Transformer

from tests.recording.flights import fly
from tests.report.conftest import coarse, cut, lines_over, write_track
from uavcover.errors import InputError
from uavcover.flight.resume import find_unfinished, save_rest
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.area import RasterTerrain
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.model.route import Plan, Route, RouteMember, RouteMetrics
from uavcover.planner.plan_files import save_plan
from uavcover.run import judged_inputs
from uavcover.run.folder import MISSION_FILES, PLAN_FILES, RunFolder, has_a_flight
from uavcover.run.judged_inputs import WHATS, JudgedInputs, inspect_inputs, judged_logs, refuse_changes
from uavcover.run.provenance import note_files, note_in_run, read_record, seal_flight
from uavcover.scenario.scenario_file import dump_scenario, terrain_source
from uavcover.scenario.site import Site, load_site

BOX = Obstacle(height_m=5.0, rings_east_north_m=(((300.0, -300.0), (309.0, -300.0), (309.0, -291.0)),))
COMMAND = ["uavcover", "test"]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with elevation data and a run of it, flown as planned up to a point and then gone on with. Not to be changed."""
    folder = tmp_path_factory.mktemp("bound")
    plain = coarse("jacksboro", 40.0)
    assert isinstance(plain.scenario.terrain, RasterTerrain)
    shutil.copy(terrain_source(plain.scenario.terrain).files[0], folder / "ground.tif")
    terrain = dataclasses.replace(plain.scenario.terrain, file=str(folder / "ground.tif"))
    site = coarse("jacksboro", 40.0, terrain=terrain, obstacles=Obstacles(prisms=(BOX,)))
    run = RunFolder(folder / "run")
    run.path.mkdir()
    route = lines_over(site, spacing_m=120.0, count=3)
    save(run, site, route)
    track = fly(site, route.waypoints_m, speed_m_s=10.0, rate_hz=5.0)
    end = len(track) // 3
    write_track(run.file("track.csv"), cut(track, slice(0, end)))
    note_in_run(run, "flight", {"ending": "link_lost"})
    seal_flight(run, samples=end, command=COMMAND)
    rest = find_unfinished(run, site)
    rest.folder.path.mkdir()
    save_rest(rest, site, command=COMMAND)
    onward = fly(site, rest.route.waypoints_m, speed_m_s=10.0, rate_hz=5.0)
    later = dataclasses.replace(onward, time_s=onward.time_s + float(track.time_s[end]) + 60.0)
    write_track(rest.folder.file("track.csv"), later)
    seal_flight(rest.folder, samples=len(later), command=COMMAND)
    note_files(run, "fly --resume", ["resumed-1/track.csv"], command=COMMAND)
    return folder


def save(run: RunFolder, site: Site, route: Route) -> RunFolder | None:
    metrics = RouteMetrics(0.5, 0.5, len(route), route.length_m, route.length_m / 10.0, 60.0, 100.0, route.length_m)
    chosen = RouteMember(route, metrics, 0.0, "boustrophedon")
    plan = Plan(chosen, (chosen,), (), "coverage>=0.4", True, "imodbo", 40, 1.5)
    compiled = compile_mission(site, route)
    return save_plan(run, site, plan, compiled=compiled, autopilot="ardupilot", seed=3, command=COMMAND)


@pytest.fixture
def run(made: Path) -> RunFolder:
    """The run, to be meddled with; put back as it was by the next one."""
    kept = made.parent / f"{made.name}-kept"
    if not kept.exists():
        shutil.copytree(made, kept)
    shutil.rmtree(made)
    shutil.copytree(kept, made)
    return RunFolder(made / "run")


def inspected(run: RunFolder) -> JudgedInputs:
    return inspect_inputs(run, judged_logs(run, ()))


def edited(path: Path, rng: random.Random) -> None:
    """One digit is another one."""
    content = bytearray(path.read_bytes())
    positions = [k for k, byte in enumerate(content) if 48 <= byte <= 57]
    position = rng.choice(positions)
    content[position] = 48 + (content[position] - 48 + rng.randint(1, 9)) % 10
    path.write_bytes(content)


def truncated(path: Path, rng: random.Random) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: rng.randrange(len(content))])


def replaced(path: Path, rng: random.Random) -> None:
    path.write_bytes(rng.randbytes(rng.randint(0, 500)))


def reformatted(path: Path, rng: random.Random) -> None:
    """The same in the eyes of most readers."""
    path.write_bytes(path.read_bytes() + rng.choice([b"\n", b" ", b"\r\n"]))


def deleted(path: Path, _: random.Random) -> None:
    path.unlink()


CHANGES = (edited, truncated, replaced, reformatted, deleted)
FILES = {
    "scenario.toml": "scenario",
    "plan.json": "plan",
    **dict.fromkeys(MISSION_FILES, "mission"),
    "track.csv": "track",
    "../ground.tif": "terrain",
    "resumed-1/plan.json": "plan",
    "resumed-1/mission.waypoints": "mission",
    "resumed-1/track.csv": "track",
}


def test_nothing_changed_nothing_named(run: RunFolder) -> None:
    found = inspected(run)
    assert found.changes == ()
    assert found.unsealed == ()
    refuse_changes(run, found, ())
    assert list(found.hashes["track"]) == ["track.csv", "resumed-1/track.csv"]
    texts = [found.hashes[name] for name in ("scenario", "terrain", "plan", "obstacles")]
    assert all(len(text) == 64 for text in [*texts, *found.hashes["track"].values()])


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
@pytest.mark.parametrize("name", FILES)
def test_every_file_and_every_change_is_named(
    run: RunFolder, name: str, change: Callable[[Path, random.Random], None]
) -> None:
    rng = random.Random(f"{name} {change.__name__}")
    change(run.file(name), rng)
    if name == "scenario.toml" and change is deleted:
        with pytest.raises(InputError, match=r"has no scenario\.toml"):
            inspected(run)
        return
    if name == "track.csv" and change is deleted:
        with pytest.raises(InputError, match=r"has no track\.csv"):
            inspected(run)
        return
    found = inspected(run)
    assert FILES[name] in {entry.what for entry in found.changes}
    shown = Path(name).name if name.startswith("..") else name
    with pytest.raises(InputError, match=rf"{shown}.*--accept-changed {FILES[name]}") as raised:
        refuse_changes(run, found, ())
    assert "\n" not in str(raised.value)
    refuse_changes(run, found, ["all"])
    others = [what for what in WHATS if what != FILES[name]]
    with pytest.raises(InputError):
        refuse_changes(run, found, others)
    if name not in ("scenario.toml", "track.csv"):
        refuse_changes(run, found, sorted({entry.what for entry in found.changes}))


def test_a_file_beside_it_that_scales_the_ground(run: RunFolder) -> None:
    beside = run.path.parent / "ground.tif.aux.xml"
    beside.write_text('<PAMDataset><PAMRasterBand band="1"><Scale>0.5</Scale></PAMRasterBand></PAMDataset>')
    assert [change.what for change in inspected(run).changes] == ["terrain"]


@pytest.mark.parametrize("name", FILES)
def test_touched_is_not_changed(run: RunFolder, name: str) -> None:
    os.utime(run.file(name), (1.0, 1.0))
    content = run.file(name).read_bytes()
    run.file(name).unlink()
    run.file(name).write_bytes(content)
    assert inspected(run).changes == ()


@pytest.mark.parametrize(
    ("section", "changes", "whats"),
    [
        ("limits", {"max_height_agl_m": 400.0}, {"scenario"}),
        ("requirements", {"min_coverage_of_coverable": 0.1}, {"scenario"}),
        ("sensor", {"range_m": 900.0}, {"scenario"}),
        ("obstacles", {"prisms": ()}, {"scenario", "obstacles"}),
        ("obstacles", {"clearance_beside_m": 0.0}, {"scenario", "obstacles"}),
        ("terrain", {"file": "elsewhere.tif"}, {"scenario", "terrain"}),
    ],
)
def test_what_loosens_a_scenario(run: RunFolder, section: str, changes: dict[str, object], whats: set[str]) -> None:
    site = load_site(run.file("scenario.toml"))
    part = dataclasses.replace(getattr(site.scenario, section), **changes)
    run.write_text("scenario.toml", dump_scenario(dataclasses.replace(site.scenario, **{section: part})))
    assert {change.what for change in inspected(run).changes} == whats


def meddled(run: RunFolder, seed: int) -> str:
    """Change the record in one of several ways; how."""
    document = json.loads(run.file("run.json").read_text())
    entries = document["provenance"]
    rng = random.Random(seed)
    ways = (
        "gone",
        "no list",
        "no plan",
        "no first entry",
        "hash of a file",
        "hash of an input",
        "swapped",
        "another version",
    )
    way = ways[seed % len(ways)]
    if way == "gone":
        run.file("run.json").unlink()
        return way
    if way == "no list":
        document.pop("provenance")
    elif way == "no plan":
        document["provenance"] = [entry for entry in entries if entry["did"] != "plan"]
    elif way == "no first entry":
        document["provenance"] = entries[1:]
    elif way == "hash of a file":
        entries[0]["wrote"][rng.choice(["plan.json", "mission.waypoints"])] = "0" * 64
    elif way == "hash of an input":
        document["inputs"]["terrain"]["sha256"] = "0" * 64
    elif way == "swapped":
        entries[0], entries[1] = entries[1], entries[0]
    else:
        entries[0]["uavcover"] = "0.0.1"
    run.file("run.json").write_text(json.dumps(document))
    return way


@pytest.mark.parametrize("seed", range(16))
def test_a_record_that_was_changed_or_removed(run: RunFolder, seed: int) -> None:
    way = meddled(run, seed)
    changes = inspected(run).changes
    assert {"record", "version"} & {change.what for change in changes}, way
    with pytest.raises(InputError, match=r"run\.json"):
        refuse_changes(run, inspected(run), ())


def test_another_version_of_uavcover(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judged_inputs, "version", lambda: "9.9")
    with pytest.raises(InputError, match=r"uavcover was .* and is now 9\.9.*--accept-changed version"):
        refuse_changes(run, inspected(run), ())


def test_a_flight_that_was_killed_has_no_hash_and_is_said(run: RunFolder) -> None:
    document = json.loads(run.file("resumed-1/run.json").read_text())
    document["provenance"] = [entry for entry in document["provenance"] if entry["did"] != "fly"]
    run.file("resumed-1/run.json").write_text(json.dumps(document))
    found = inspected(run)
    assert found.unsealed == ("resumed-1/track.csv",)
    assert found.changes == ()
    document = json.loads(run.file("resumed-1/run.json").read_text())
    run.file("resumed-1/run.json").write_text(json.dumps({**document, "flight": {"ending": "landed"}}))
    assert [change.what for change in inspected(run).changes] == ["record"], "it landed, and its hash was taken away"


def test_flights_that_are_taken_away_are_missed(run: RunFolder) -> None:
    shutil.rmtree(run.file("resumed-1"))
    (change,) = inspected(run).changes
    assert (change.what, change.file, change.now) == ("track", "resumed-1/track.csv", None)


def test_a_link_that_is_cut_is_no_shorter_flight(run: RunFolder) -> None:
    document = json.loads(run.file("resumed-1/run.json").read_text())
    document.pop("resumes")
    run.file("resumed-1/run.json").write_text(json.dumps(document))
    assert "track" in {change.what for change in inspected(run).changes}


def test_a_foreign_log_has_a_hash_and_nothing_to_compare(run: RunFolder, tmp_path: Path) -> None:
    log = tmp_path / "mine.csv"
    shutil.copy(run.file("track.csv"), log)
    found = inspect_inputs(run, [log])
    assert list(found.hashes["track"]) == ["mine.csv"]
    assert found.changes == ()


def test_another_word(run: RunFolder) -> None:
    with pytest.raises(InputError, match="'everything' is not one of scenario, terrain"):
        refuse_changes(run, inspected(run), ["everything"])


def test_the_record_is_never_replaced(run: RunFolder) -> None:
    before = json.loads(run.file("run.json").read_text())["provenance"]
    site = load_site(run.file("scenario.toml"))
    tracks = {name: run.file(name).read_bytes() for name in ("track.csv", "resumed-1/track.csv")}
    older = save(run, site, lines_over(site, spacing_m=150.0, count=2))
    assert older is not None
    after = json.loads(run.file("run.json").read_text())["provenance"]
    assert after[: len(before)] == before
    assert [entry["did"] for entry in after[len(before) :]] == ["plan"]
    assert read_record(run).faults == ()
    # The plan that was flown is a run folder of its own, whole; nothing of it is left beside the new plan.
    assert older.path == run.path / "older-1"
    assert {name: older.file(name).read_bytes() for name in tracks} == tracks
    assert inspected(older).changes == ()
    assert not has_a_flight(run)
    assert inspect_inputs(run, ()).changes == ()
    assert {path.name for path in run.path.iterdir()} == {*PLAN_FILES, *MISSION_FILES, "older-1"}


def test_a_plan_that_was_not_flown_leaves_nothing_behind(run: RunFolder) -> None:
    site = load_site(run.file("scenario.toml"))
    shutil.rmtree(run.file("resumed-1"))
    run.file("track.csv").unlink()
    for name in ("gaps", "sortie-2"):
        shutil.copytree(run.path, run.file(name), ignore=shutil.ignore_patterns("gaps", "sortie-*"))
    run.file("sortie-2/notes.txt").write_text("mine")
    for name in ("upload.json", "report.html", "gaps/upload.json", "verification.json"):
        run.file(name).write_text("{}")
    assert save(run, site, lines_over(site, spacing_m=150.0, count=2)) is None
    left = {path.name for path in run.path.iterdir()}
    assert left == {*PLAN_FILES, *MISSION_FILES, "sortie-2"}
    assert [path.name for path in run.file("sortie-2").iterdir()] == ["notes.txt"], "what others put there stays"


def nested(file: Path, inner: Path) -> None:
    """A virtual raster over another one, as gdalbuildvrt writes it."""
    with rasterio.open(inner) as raster:
        size = f'xSize="{raster.width}" ySize="{raster.height}"'
        file.write_text(
            f'<VRTDataset rasterXSize="{raster.width}" rasterYSize="{raster.height}"><SRS>{escape(raster.crs.to_wkt())}</SRS>'
            f"<GeoTransform>{', '.join(map(repr, raster.transform.to_gdal()))}</GeoTransform>"
            '<VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
            f'<SourceFilename relativeToVRT="1">{inner.name}</SourceFilename><SourceBand>1</SourceBand>'
            f'<SrcRect xOff="0" yOff="0" {size}/><DstRect xOff="0" yOff="0" {size}/></SimpleSource></VRTRasterBand></VRTDataset>'
        )


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_a_tile_under_virtual_rasters_is_noticed(run: RunFolder, depth: int) -> None:
    folder = run.path.parent
    for level in range(depth):
        nested(folder / f"level{level}.vrt", folder / ("ground.tif" if level == 0 else f"level{level - 1}.vrt"))
    site = load_site(run.file("scenario.toml"))
    terrain = dataclasses.replace(site.scenario.terrain, file=str(folder / f"level{depth - 1}.vrt"))
    before = load_site(dataclasses.replace(site.scenario, terrain=terrain)).bare_ground.sha256
    assert before == load_site(dataclasses.replace(site.scenario, terrain=terrain)).bare_ground.sha256
    east_m, north_m = site.area.centroid.coords[0]
    lat, lon, _ = site.frame.geodetic_from_enu(np.array([[east_m, north_m, 0.0]]))
    with rasterio.open(folder / "ground.tif", "r+") as raster:
        x, y = Transformer.from_crs(4326, raster.crs, always_xy=True).transform(lon[0], lat[0])
        row, column = raster.index(x, y)
        window = ((row, row + 1), (column, column + 1))
        raster.write(raster.read(1, window=window) + 1, 1, window=window)
    changed = load_site(dataclasses.replace(site.scenario, terrain=terrain)).bare_ground.sha256
    assert changed != before
