"""``uavcover check`` on the bundled elevation data."""

import json
from pathlib import Path

import pytest

import uavcover
from tests.cli.conftest import Cli
from uavcover.cli.new import ElevationData
from uavcover.extras.check.mission_file import CheckQuery, aircraft_of, read_mission_file

DEM = Path(uavcover.__file__).parent / "data" / "jacksboro.tif"
HOME = "0\t1\t0\t16\t0\t0\t0\t0\t36.4762\t-84.2160\t485\t1"
GOOD = ("22 0 0 40", "16 36.4770 -84.2160 70", "16 36.4770 -84.2150 70", "20 0 0 0")


def mission(folder: Path, *rows: str, name: str = "m.waypoints", frame: int = 3) -> Path:
    """A file of rows "command latitude longitude height"."""
    lines = ["QGC WPL 110", HOME]
    for number, row in enumerate(rows, 1):
        command, lat, lon, height = row.split()
        lines.append(f"{number}\t0\t{frame}\t{command}\t0\t0\t0\t0\t{lat}\t{lon}\t{height}\t1")
    file = folder / name
    file.write_text("\n".join(lines) + "\n")
    return file


def test_a_good_mission(cli: Cli, tmp_path: Path) -> None:
    ended = cli("check", mission(tmp_path, *GOOD), "--dem", DEM, "--return-height", "70m", code=0)
    assert ended.out.splitlines()[-1] == "verdict: passed"


def test_a_hill_in_the_way(cli: Cli, tmp_path: Path) -> None:
    file = mission(tmp_path, "22 0 0 40", "16 36.4770 -84.2160 70", "16 36.4850 -84.2240 70", "20 0 0 0")
    ended = cli("check", file, "--dem", DEM, "--json", "--map", tmp_path / "found.geojson", code=1)
    assert ended.document["verdict"] == "failed"
    (leg,) = [one for one in ended.document["findings"] if one["kind"] == "ground" and one["items"] == [2, 3]]
    assert leg["by"] > 50.0
    assert 36.4770 < leg["lat_deg"] <= 36.4850
    assert ended.document["figures"]["min_height_agl_m"] == pytest.approx(10.0 - leg["by"], abs=1.0)
    drawn = json.loads((tmp_path / "found.geojson").read_text())
    kinds = {feature["geometry"]["type"] for feature in drawn["features"]}
    assert kinds == {"LineString", "Point"}
    assert "--force" in cli("check", file, "--dem", DEM, "--map", tmp_path / "found.geojson", code=2).error


def test_a_home_without_a_height_is_on_the_ground_there(cli: Cli, tmp_path: Path) -> None:
    def item(command: int, *position: float) -> dict[str, object]:
        return {
            "type": "SimpleItem", "command": command, "frame": 3, "autoContinue": True, "doJumpId": 1,
            "params": [0, 0, 0, None, *position],
        }  # fmt: skip

    items = [item(22, 0, 0, 40), item(16, 36.4770, -84.2160, 70), item(16, 36.4770, -84.2150, 70), item(20, 0, 0, 0)]
    verdicts = []
    for height in (None, 485.0):
        mission = {
            "version": 2, "firmwareType": 3, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "items": items,
            "plannedHomePosition": [36.4755, -84.2160, height],
        }  # fmt: skip
        part = {"version": 2}
        document = {
            "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission,
            "geoFence": {**part, "circles": [], "polygons": []}, "rallyPoints": {**part, "points": []},
        }  # fmt: skip
        (tmp_path / "m.plan").write_text(json.dumps(document))
        ended = cli("check", tmp_path / "m.plan", "--dem", DEM, "--return-height", "70m", "--json")
        # The only difference is that a height can be compared with the ground.
        findings = [one for one in ended.document["findings"] if one["kind"] != "home"]
        verdicts.append((findings, ended.document["figures"]))
    assert verdicts[0] == verdicts[1]


def test_fence_and_zones_of_files(cli: Cli, tmp_path: Path) -> None:
    file = mission(tmp_path, *GOOD)
    ring = [[-84.2155, 36.4765], [-84.2153, 36.4765], [-84.2153, 36.4775], [-84.2155, 36.4775], [-84.2155, 36.4765]]
    shape = tmp_path / "zone.geojson"
    shape.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    entered = cli("check", file, "--dem", DEM, "--return-height", "70m", "--no-fly", shape, "--json", code=1)
    assert {(one["kind"], *one["items"]) for one in entered.document["findings"] if one["weight"] == "breaks"} == {
        ("no-fly", 2, 4),
        ("return-no-fly", 2, 3),
    }
    timed = {
        "type": "Feature",
        "properties": {"active": "SAT,SUN"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    (tmp_path / "weekend.geojson").write_text(json.dumps(timed))
    weekend = ("check", file, "--dem", DEM, "--return-height", "70m", "--no-fly", tmp_path / "weekend.geojson")
    for more, code, said in (
        ((), 1, "1 no-fly zone has a schedule, but was treated as always active"),
        (("--at", "2026-06-06T09:00Z"), 1, ""),
        (("--at", "2026-06-05T09:00Z/2h"), 0, "1 of 1 no-fly zone, inactive at that time, was ignored"),
    ):
        ended = cli(*weekend, *more)
        assert (ended.code, said in ended.out) == (code, True), ended.out
    left = cli("check", file, "--dem", DEM, "--return-height", "70m", "--fence", shape, "--json")
    assert {one["kind"] for one in left.document["findings"] if one["weight"] == "breaks"} == {"fence", "return-fence"}


def test_a_plan_brings_its_autopilot_and_its_fence(cli: Cli, tmp_path: Path) -> None:
    from mission_io.formats import plan
    from mission_io.formats.files import read_mission
    from mission_io.model.items import Fence, FenceCircle, LatLon

    fence = Fence(circles=(FenceCircle(LatLon(36.4762, -84.2160), 60.0),))
    made = plan.PlanFile(read_mission(mission(tmp_path, *GOOD)), fence, plan.RallyPoints(), 12)
    file = tmp_path / "m.plan"
    file.write_text(plan.write(made))
    ended = cli("check", file, "--dem", DEM, "--json")
    # PX4 returns 30 m above home, ArduCopter 15 m; the circle of 60 m is left.
    assert {one["kind"] for one in ended.document["findings"] if one["weight"] == "breaks"} == {"fence"}


CORNERS = (
    "-84.21555,36.47695,60 -84.21545,36.47695,60 -84.21545,36.47705,60 -84.21555,36.47705,60 -84.21555,36.47695,60"
)
TOWER = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>silo</name><Polygon>'
    "<extrude>1</extrude><altitudeMode>relativeToGround</altitudeMode><outerBoundaryIs><LinearRing><coordinates>"
    f"{CORNERS}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
)


@pytest.mark.parametrize("reported", [60.0, 61.0, 20.0])
def test_obstacles_of_map_programs(cli: Cli, tmp_path: Path, reported: float) -> None:
    """The silo stands on the leg from item 2 to item 3, whose height is 70 m above home."""
    kml = tmp_path / "silo.kml"
    kml.write_text(TOWER.replace(",60", f",{reported}"))
    data = f'<ExtendedData><Data name="height_m"><value>{reported}</value></Data></ExtendedData><Polygon>'
    flat = tmp_path / "flat.kml"
    flat.write_text(TOWER.replace("relativeToGround", "clampToGround").replace("<Polygon>", data))
    ring = [[float(number) for number in corner.split(",")[:2]] for corner in CORNERS.split()]
    feature = {"type": "Feature", "properties": {"height_m": reported, "name": "silo"}}
    plain = tmp_path / "silo.geojson"
    plain.write_text(json.dumps({**feature, "geometry": {"type": "Polygon", "coordinates": [ring]}}))
    outcomes = []
    for file in (kml, flat, plain):
        ended = cli(
            "check", mission(tmp_path, *GOOD), "--dem", DEM, "--return-height", "90m", "--obstacles", file, "--json"
        )
        outcomes.append(
            [(one["kind"], one["items"], one["what"], round(one["by"], 2)) for one in ended.document["findings"]]
        )
    assert outcomes[0] == outcomes[1] == outcomes[2]
    assert [row[:2] for row in outcomes[0] if row[0] == "obstacle"] == (
        [] if reported == 20.0 else [("obstacle", [2, 3])]
    )


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (("nowhere.plan", "--dem", DEM), "no such file"),
        (("m.waypoints",), "--dem"),
        (("m.docx", "--dem", DEM), ".docx is not supported"),
        (("fence.waypoints", "--dem", DEM), "no mission"),
        (("empty.waypoints", "--dem", DEM), "no items"),
        (("broken.waypoints", "--dem", DEM), "broken.waypoints"),
        (("m.waypoints", "--dem", "none.tif"), "none.tif: no such file; set --dem"),
        (("m.waypoints", "--dem", DEM, "--min-height", "130m"), "greater than --max-height (120 m)"),
        (("m.waypoints", "--dem", DEM, "--vehicle", "bicycle"), "bicycle"),
        (("m.waypoints", "--dem", DEM, "--flies-as", "bird"), "bird"),
        (("m.waypoints", "--dem", DEM, "--autopilot", "me"), "me"),
        (("m.waypoints", "--dem", DEM, "--reserve", "100"), "--reserve"),
        (("m.waypoints", "--dem", DEM, "--reserve", "nan"), "--reserve"),
        (("m.waypoints", "--dem", DEM, "--min-height", "10"), "--min-height"),
        (("m.waypoints", "--dem", DEM, "--fence", "m.waypoints"), "--fence"),
        (("m.waypoints", "--dem", DEM, "--fence", "no.waypoints"), "--fence"),
        (("m.waypoints", "--dem", DEM, "--no-fly", "no.json"), "no.json"),
        (("m.waypoints", "--dem", DEM, "--obstacles", "no.kml"), "no.kml"),
        (("m.waypoints", "--dem", DEM, "--obstacles", "flat.kml"), "no height above ground"),
        (("m.waypoints", "--dem", DEM, "--obstacles", "m.waypoints"), ".geojson"),
        (("m.waypoints", "--dem", DEM, "--obstacles", "boxes.csv"), "longitudes and latitudes"),
        (("m.waypoints", "--dem", DEM, "--obstacle-clearance", "ten"), "--obstacle-clearance"),
        (("m.waypoints", "--dem", DEM, "--home", "91,0"), "--home"),
        (("m.waypoints", "--dem", DEM, "--map", "x.png"), ".geojson"),
        (("m.waypoints", "--dem", DEM, "--fix"), "-o"),
        (("m.waypoints", "--dem", DEM, "-o", "n.waypoints"), "--fix"),
        (("m.waypoints", "--dem", DEM, "--fix", "-o", "n.plan"), "n.plan"),
        (("m.waypoints", "--dem", DEM, "--fix", "-o", "m.waypoints", "--force"), "the original mission"),
        (("m.waypoints", "--dem", DEM, "--fix", "-o", "broken.waypoints"), "--force"),
        (("swapped.waypoints", "--dem", DEM, "--fix", "-o", "n.waypoints"), "correct this first"),
    ],
)
def test_bad_input_is_one_line(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[object, ...], telling: str
) -> None:
    monkeypatch.chdir(tmp_path)
    mission(tmp_path, *GOOD)
    (tmp_path / "m.docx").write_text("?")
    (tmp_path / "flat.kml").write_text(TOWER.replace("relativeToGround", "clampToGround"))
    columns = "name,east_m,north_m,length_m,width_m,heading_deg,height_m"
    (tmp_path / "boxes.csv").write_text(f"{columns}\na,0,0,5,5,0,10\n")
    mission(tmp_path, "5003 36.4762 -84.216 0", name="fence.waypoints")
    (tmp_path / "fence.waypoints").write_text(f"QGC WPL 110\n{HOME}\n1\t0\t0\t5003\t50\t0\t0\t0\t36.47\t-84.2\t0\t1\n")
    mission(tmp_path, "22 0 0 40", "16 -84.2160 36.4770 70", "20 0 0 0", name="swapped.waypoints")
    (tmp_path / "empty.waypoints").write_text(f"QGC WPL 110\n{HOME}\n")
    (tmp_path / "broken.waypoints").write_text("QGC WPL 110\n1 2 three\n")
    assert telling in cli("check", *arguments, code=2).error


def test_a_mission_of_another_place(cli: Cli, tmp_path: Path) -> None:
    file = mission(tmp_path, *GOOD)
    file.write_text(file.read_text().replace("\t36.", "\t46."))
    assert "the mission lies outside the elevation data" in cli("check", file, "--dem", DEM, code=1).out


@pytest.mark.parametrize("name", ["m.waypoints", "m.plan"])
def test_a_repaired_mission_is_checked_again(cli: Cli, tmp_path: Path, name: str) -> None:
    from mission_io.formats import plan
    from mission_io.formats.files import read_mission
    from mission_io.model.items import Fence

    rows = ("22 0 0 40", "16 36.4770 -84.2160 70", "16 36.4800 -84.2190 300", "16 36.4850 -84.2240 480", "20 0 0 0")
    file = mission(tmp_path, *rows)
    if name == "m.plan":
        made = plan.PlanFile(read_mission(file), Fence(), plan.RallyPoints(), 3)
        file = tmp_path / name
        file.write_text(plan.write(made))
    before, options = file.read_bytes(), ("--dem", DEM, "--return-height", "500m", "--max-height", "none", "--json")
    cli("check", file, *options, code=1)
    fixed = tmp_path / f"fixed{file.suffix}"
    ended = cli("check", file, *options, "--fix", "-o", fixed)
    assert (ended.code, ended.document["verdict"], ended.document["file"]) == (0, "passed", str(fixed))
    assert file.read_bytes() == before
    assert len(read_mission(fixed).items) >= 5
    options = ["--return-height", "500m", "--max-height", "none", "--fix", "-o"]
    unchanged = cli("check", fixed, "--dem", DEM, *options, tmp_path / f"2{file.suffix}", code=0)
    assert "no file was written" in unchanged.out


@pytest.mark.parametrize("name", ["r.gpx", "r.kml", "r.csv", "r.wpml"])
def test_routes_of_points_have_a_take_off_and_no_home(cli: Cli, tmp_path: Path, name: str) -> None:
    from tests.mission_io.formats.route_files import ROUTES

    file = tmp_path / name
    file.write_text(
        ROUTES[file.suffix]([(36.4770, -84.2160, 560.0 - 485.0), (36.4770, -84.2150, 560.0 - 485.0)], 485.0)
    )
    ended = cli("check", file, "--dem", DEM, "--home", "36.4762,-84.2160", "--return-height", "70m", code=0)
    assert "point 1" in ended.out
    options = ["--home", "36.4762,-84.2160", "--min-height", "90m", "--fix", "-o"]
    fixed = cli("check", file, "--dem", DEM, *options, tmp_path / "f.waypoints")
    assert "raised" in fixed.out, fixed


def test_a_long_mission_is_split_and_each_part_is_checked(cli: Cli, tmp_path: Path) -> None:
    waypoints = [f"16 36.47{70 + k % 2} -84.21{60 - k // 2} 70" for k in range(14)]
    file = mission(tmp_path, "22 0 0 70", *waypoints, "20 0 0 0")
    options = ("--dem", DEM, "--return-height", "90m", "--max-height", "none", "--max-items", "12", "--json")
    reported = cli("check", file, *options, code=1)
    assert [one["kind"] for one in reported.document["findings"] if one["weight"] == "breaks"] == ["items"]
    ended = cli("check", file, *options, "--fix", "-o", tmp_path / "part.waypoints", code=0)
    names = [one["file"] for one in ended.document["parts"]]
    assert names == [str(tmp_path / f"part-{k}.waypoints") for k in range(1, len(names) + 1)]
    assert len(names) > 2
    assert ended.document["verdict"] == "passed"
    again = cli("check", file, *options, "--fix", "-o", tmp_path / "part.waypoints")
    assert (again.code, "--force" in again.err) == (2, True)
    cli("check", file, *options[:-2], "3", code=2)


def test_rally_points_and_parameters_of_files(cli: Cli, tmp_path: Path) -> None:
    """They were read and ignored: a rally point inside the ground passed."""
    from mission_io.formats import wpl
    from mission_io.formats.files import read_mission
    from mission_io.model.items import FramedPoint, RallyPoints

    file = mission(tmp_path, *GOOD)
    home = read_mission(file).home
    assert home is not None
    rally = tmp_path / "rally.waypoints"
    rally.write_text(wpl.write_rally(RallyPoints((FramedPoint(36.4762, -84.2160, -60.0),)), home))
    plain = ("check", file, "--dem", DEM, "--return-height", "70m", "--json")
    cli(*plain, code=0)
    ended = cli(*plain, "--rally", rally, code=1)
    assert "rally point 1: it is" in {one["kind"]: one["what"] for one in ended.document["findings"]}["rally"]
    low = tmp_path / "low.param"
    beyond_a_ridge = mission(
        tmp_path, "22 0 0 110", "16 36.4819 -84.2089 110", "16 36.4819 -84.2089 30", "21 36.4819 -84.2089 0"
    )
    for height_cm, code in ((2_000, 1), (12_000, 0)):
        low.write_text(f"# saved\nRTL_ALT,{height_cm}\nRTL_CONE_SLOPE 0\n1\t1\tFS_GCS_ENABLE\t1\t2\n")
        ended = cli("check", beyond_a_ridge, "--dem", DEM, "--parameters", low, "--max-height", "none", "--json")
        assert ended.code == code
        unsafe = [one["what"] for one in ended.document["findings"] if one["kind"] == "return"]
        assert len(unsafe) == code
        assert all("(FS_GCS_ENABLE 1)" in what for what in unsafe)
    low.write_text("RTL_ALT high\n")
    assert (
        "line 1: 'RTL_ALT high' is not a name and a number" in cli("check", file, "--dem", DEM, "--parameters", low).err
    )


def test_a_return_of_the_mission_has_the_height_of_the_parameters(cli: Cli, tmp_path: Path) -> None:
    """It was flown at the autopilot's default, whatever the file of parameters said."""
    file = mission(tmp_path, "22 0 0 110", "16 36.4819 -84.2089 110", "16 36.4819 -84.2089 30", "20 0 0 0")
    own, plain = tmp_path / "own.param", ("check", file, "--dem", DEM, "--max-height", "none", "--json")
    for line, more, code in (
        ("RTL_ALT 12000", [], 0), ("RTL_ALT 2000", [], 1), ("RTL_ALT 2000", ["--return-height", "120m"], 0),
        ("RTL_ALT 12000", ["--return-height", "20m"], 1), ("RTL_RETURN_ALT 120", ["--autopilot", "px4"], 0),
        ("RTL_ALTITUDE 120", ["--flies-as", "fixed-wing"], 0), ("ALT_HOLD_RTL 2000", ["--flies-as", "fixed-wing"], 1),
    ):  # fmt: skip
        own.write_text(f"{line}\n")
        findings = cli(*plain, "--parameters", own, *more).document["findings"]
        low = [one for one in findings if one["kind"] == "ground" and one["items"][1] == 4]
        assert len(low) == code, (line, more, findings)


def test_the_time_is_that_of_the_plan_or_of_the_vehicles_parameters(cli: Cli, planned: Path, tmp_path: Path) -> None:
    dem = ("--dem", "uavcover/data/jacksboro.tif")
    planned_s = json.loads((planned / "plan.json").read_text())["metrics"]["mission_time_s"]
    ended = cli("check", planned / "mission.waypoints", *dem, "--json")
    assert ended.document["figures"]["time_s"] == pytest.approx(planned_s, rel=0.01)
    assert f"from the plan in {planned}" in ended.err
    elsewhere = tmp_path / "mission.waypoints"
    elsewhere.write_bytes((planned / "mission.waypoints").read_bytes())
    slow = cli("check", elsewhere, *dem, "--json")
    assert slow.document["figures"]["time_s"] > 1.1 * planned_s
    assert "climb 2.5 m/s, descent 1.5 m/s, acceleration 2.5 m/s2; from the defaults of ArduPilot" in slow.err
    (tmp_path / "own.param").write_text("WPNAV_SPEED_UP,500\nWPNAV_SPEED_DN,500\n")
    own = cli("check", elsewhere, *dem, "--parameters", tmp_path / "own.param", "--json")
    assert own.document["figures"]["time_s"] == pytest.approx(planned_s, rel=0.02)


@pytest.mark.parametrize("name", ["mission.waypoints", "mission.plan"])
def test_a_run_is_checked_with_what_it_was_planned_for(cli: Cli, planned: Path, name: str) -> None:
    """Its returns had the autopilot's default height, and ``.waypoints`` neither the fence nor the rally points beside it."""
    file, asked = planned / name, ("--dem", "uavcover/data/jacksboro.tif", "--json")
    assert cli("check", file, *asked).code == 0
    aircraft = aircraft_of(CheckQuery(file=file, elevation=ElevationData(names=(str(DEM),))), read_mission_file(file))
    assert (aircraft.return_height_m, aircraft.return_height_from) == (80.0, "as planned")
    rally = "1\t0\t3\t5100\t0\t0\t0\t0\t36.48\t-84.22\t-99\t1"
    (planned / "rally.waypoints").write_text(f"QGC WPL 110\n{HOME}\n{rally}\n")
    findings = cli("check", file, *asked).document["findings"]
    assert ("rally" in {one["kind"] for one in findings}) == (name == "mission.waypoints")
