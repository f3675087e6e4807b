"""``uavcover verify`` and ``gaps``."""

import csv
import itertools
import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from pymavlink import mavwp
from rasterio.warp import transform

from tests.cli.conftest import Cli, files
from tests.verification.test_flown_blocks import Elsewhere
from uavcover.missions.mission_compiler import compile_mission
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import seal_flight
from uavcover.sensing.site_maps import judging_map


def shifted(run: Path, north_m: float) -> None:
    with (run / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (run / "track.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            row["lat_deg"] = repr(float(row["lat_deg"]) + float(np.degrees(north_m / 6.36e6)))
            row["north_m"] = repr(float(row["north_m"]) + north_m)
            writer.writerow(row)


def test_recomputed_from_the_track(cli: Cli, flown: Path) -> None:
    before = json.loads((flown / "verification.json").read_text())
    ended = cli("verify", flown, "--json", code=0)
    assert ended.document == before == json.loads((flown / "verification.json").read_text())


def test_a_log_may_contain_other_flights_and_the_same_one_again(cli: Cli, flown: Path, tmp_path: Path) -> None:
    with (flown / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    begin_s, end_s = (float(rows[k]["time_s"]) for k in (0, -1))
    several: list[dict[str, str]] = []
    for number, north_m in enumerate((900.0, 0.0, 0.0)):
        for row in rows:
            time_s = float(row["time_s"]) + number * (end_s - begin_s + 60.0)
            lat = repr(float(row["lat_deg"]) + float(np.degrees(north_m / 6.36e6)))
            place = {"lat_deg": lat, "north_m": repr(float(row["north_m"]) + north_m), "current_waypoint": "-1"}
            several.append({**row, **place, "time_s": repr(time_s), "unix_time_s": "", "received_utc_s": ""})
    log = tmp_path / "log.csv"
    for count, follow in (
        (1, ""),
        (2, "1 follows the plan; the others are ignored"),
        (3, "2 follow the plan; the others"),
    ):
        with log.open("w") as file:
            writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
            writer.writeheader()
            writer.writerows(several[: count * len(rows)])
        document = cli("verify", flown, "--log", log, "--json").document
        assert (document["verdict"] == "passed") == bool(follow), document["reasons"]
        assert any(f"log.csv contains {count} flights; {follow}" in text for text in document["findings"]) == bool(
            follow
        )


def test_workers_give_the_same_verdict(cli: Cli, flown: Path, monkeypatch) -> None:
    requested: list[str] = []
    monkeypatch.setattr(
        "uavcover.verification.flown_coverage.workers_of",
        lambda name: requested.append(name) or nullcontext(Elsewhere()),
    )
    before = json.loads((flown / "verification.json").read_text())
    ended = cli("verify", flown, "--scheduler", "tcp://there:8786", "--json")
    assert requested == ["tcp://there:8786"]
    assert ended.document == before


def test_shifted_by_200_m_does_not_pass(cli: Cli, flown: Path) -> None:
    shifted(flown, 200.0)
    refused = cli("verify", flown, code=2)
    assert "track.csv was" in refused.error
    assert "--accept-changed track" in refused.error
    assert not {"verification.json", "report.html", "coverage.tif"} & files(flown), "no older verdict stays"
    cli("report", flown, code=2)
    ended = cli("verify", flown, "--accept-changed", "track", code=1)
    assert "accepted change   track: track.csv was" in ended.out
    cli("report", flown, code=0)
    assert "accepted change since planning or flight: track.csv was" in (flown / "report.html").read_text()
    assert "FAILED" in ended.out
    verdict = json.loads((flown / "verification.json").read_text())
    assert verdict["passed"] is False
    assert verdict["verdict"] == "failed"
    assert verdict["max_deviation_m"] > 50.0


def test_recording_gives_the_same_verdict(cli: Cli, flown: Path) -> None:
    by_csv = cli("verify", flown, "--json").document
    by_rrd = cli("verify", flown, "--log", flown / "flight.rrd", "--json").document
    assert by_rrd.pop("track") == "flight.rrd"
    assert by_csv.pop("track") == "track.csv"
    assert list(by_rrd.pop("inputs")["track"]) == ["flight.rrd"]
    assert list(by_csv.pop("inputs")["track"]) == ["track.csv"]
    assert by_rrd == by_csv


def test_needs_no_plan(cli: Cli, flown: Path) -> None:
    (flown / "plan.json").unlink()
    assert "plan.json was" in cli("verify", flown).error
    ended = cli("verify", flown, "--accept-changed", "plan", "--json")
    assert ended.document["planned_coverage_fraction"] is None
    assert [(change["what"], change["now"]) for change in ended.document["accepted_changes"]] == [("plan", None)]


def test_last_line_cut_off(cli: Cli, flown: Path) -> None:
    text = (flown / "track.csv").read_text()
    (flown / "track.csv").write_text(text[:-20])
    cli("verify", flown, code=2)
    assert "the last line is incomplete" in cli("verify", flown, "--accept-changed", "track").err


@pytest.mark.parametrize("name", ["flight.log", "flight", "plan.json"])
def test_other_endings(cli: Cli, flown: Path, name: str) -> None:
    if not (flown / name).exists():
        shutil.copy(flown / "track.csv", flown / name)
    assert "use .csv, .rrd, .bin, .tlog, .ulg, .gpx" in cli("verify", flown, "--log", flown / name, code=2).error


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.csv", b""), ("x.csv", b"a,b\n1,2\n"), ("x.rrd", b"no recording"), ("x.csv", b"\xff\xfe"), ("gone.csv", None)],
)
def test_files_that_are_no_track(cli: Cli, flown: Path, tmp_path: Path, name: str, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert name in cli("verify", flown, "--log", tmp_path / name, code=2).error
    assert not {"verification.json", "report.html"} & files(flown), "a verdict that failed leaves no older one"


def test_nothing_flown(cli: Cli, planned: Path) -> None:
    assert "uavcover fly" in cli("verify", planned, code=2).error


def test_what_is_no_run_folder_is_left_alone(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    assert "has no scenario.toml" in cli("verify", tmp_path).error
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_word_that_names_nothing(cli: Cli, flown: Path) -> None:
    before = files(flown)
    assert "'everything' is not one of scenario" in cli("verify", flown, "--accept-changed", "everything").error
    assert files(flown) == before


def test_a_report_without_a_verdict_or_with_another_one_says_so(cli: Cli, flown: Path) -> None:
    cli("report", flown, "--log", flown / "flight.rrd", code=0)
    assert "verification.json was computed from different inputs" in (flown / "report.html").read_text()
    (flown / "verification.json").unlink()
    cli("report", flown, code=0)
    assert "the run folder contains no verdict from uavcover verify" in (flown / "report.html").read_text()
    (flown / "scenario.toml").write_text((flown / "scenario.toml").read_text() + "\n")
    assert f"uavcover verify {flown} --accept-changed scenario" in cli("report", flown).error
    assert not (flown / "report.html").exists()
    assert "--accept-changed scenario" in cli("gaps", flown).error


def test_photos_can_only_be_required_of_a_sensor_that_takes_some(cli: Cli, flown: Path) -> None:
    assert "--require-photos: the sensor of" in cli("verify", flown, "--require-photos", code=2).error


def sealed(run: Path) -> None:
    """Record the track as one that ended so."""
    seal_flight(RunFolder(run), samples=1, command=[])


def without_legs(run: Path, first: int, last: int) -> None:
    """Take the samples on the legs to these waypoints out of the track."""
    with (run / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (run / "track.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(row for row in rows if not first <= int(row["current_waypoint"]) <= last)


@pytest.fixture
def torn(flown: Path) -> Path:
    """A run whose track has lost some legs in its middle."""
    count = len(json.loads((flown / "plan.json").read_text())["waypoints"])
    without_legs(flown, count // 2, count // 2 + count // 8)
    sealed(flown)
    return flown


def test_a_gap_mission_is_flown_and_both_tracks_reach_the_plan(cli: Cli, torn: Path) -> None:
    before = cli("verify", torn, "--json").document
    assert before["coverage_fraction"] < before["planned_coverage_fraction"] - 0.001
    planned = before["planned_coverage_fraction"]
    answer = cli("gaps", torn, "--target", planned, "--json", code=0)
    first_m = np.linalg.norm(np.diff(compile_mission(*route_of(torn)).path_m, axis=0), axis=1).sum()
    assert answer.document["path_length_m"] < 0.5 * first_m
    assert answer.document["coverage_after"] >= planned
    assert (torn / "gap_mission.waypoints").read_bytes() == (torn / "gaps" / "mission.waypoints").read_bytes()
    cli("fly", torn / "gaps", "--to", "mock:", "--mock-speed", 200, code=0)
    both = cli("verify", torn, "--log", torn / "track.csv", "--log", torn / "gaps" / "track.csv", "--json")
    # All is seen now, but what the first track does not show stays unobserved.
    assert (both.code, both.document["verdict"]) == (1, "not proved"), both.out
    assert both.document["reasons"] == []
    assert both.document["planned_coverage_fraction"] == planned
    assert both.document["coverage_fraction"] >= planned
    assert both.document["track"] == "track.csv, gaps/track.csv"
    assert both.document["violations"] == []
    # The gap mission's own plan is what its track is compared with.
    assert both.document["max_deviation_m"] < 10.0


def route_of(run: Path):  # type: ignore[no-untyped-def]
    site, planned = read_planned(RunFolder(run))
    return site, planned.route


def test_the_gaps_as_geojson_are_where_the_verdict_says(cli: Cli, torn: Path) -> None:
    verdict = cli("verify", torn, "--json").document
    cli("gaps", torn, code=0)
    features = json.loads((torn / "gaps.geojson").read_text())["features"]
    assert len(features) == len(verdict["gaps"])
    size_m = judging_map(route_of(torn)[0]).grid.size_m
    for feature, gap in zip(features, verdict["gaps"], strict=True):
        assert feature["properties"]["reason"] == gap["reason"]
        shape = shapely.geometry.shape(feature["geometry"])
        assert shape.is_valid
        assert shape.convex_hull.buffer(1e-6).contains(shapely.Point(gap["lon_deg"], gap["lat_deg"]))
        # Map area against the number of cells, a degree of latitude being 111 km.
        area_m2 = shape.area * 111.0e3 * 111.32e3 * np.cos(np.radians(gap["lat_deg"]))
        assert area_m2 == pytest.approx(size_m**2 * gap["cells"], rel=0.005)


def test_the_raster_lies_on_the_cells_and_says_what_the_verdict_says(cli: Cli, torn: Path) -> None:
    verdict = cli("verify", torn, "--json").document
    site, _ = route_of(torn)
    coverage = judging_map(site)
    with rasterio.open(torn / "coverage.tif") as raster:
        looks, reason = raster.read(1), raster.read(raster.count)
        assert raster.descriptions == (
            "looks", "first_seen_s", "ground_sample_m", "incidence_deg", "distance_m", "sureness", "reason",
        )  # fmt: skip
        inside = np.isfinite(looks)
        assert inside.sum() == coverage.grid.count == verdict["cells"]["count"]
        assert (looks[inside] > 0).sum() == verdict["cells"]["seen"]
        assert looks[inside].max() == verdict["cells"]["looks_max"]
        np.testing.assert_array_equal(reason[inside] == 0, looks[inside] > 0)
        middles = coverage.grid.middles_m[:: coverage.grid.count // 50]
        centres = np.column_stack([middles, site.ground.heights_m(middles)])
        assert site.frame is not None
        lat, lon, _ = site.frame.geodetic_from_enu(centres)
        x, y = transform("EPSG:4326", raster.crs, lon, lat)
        rows, columns = rasterio.transform.rowcol(raster.transform, x, y, op=lambda value: value)
        lattice = coverage.grid.cells
        np.testing.assert_allclose(columns, (centres[:, 0] - lattice.east0_m) / lattice.size_m + 0.5, atol=0.01)
        from_north = lattice.lattice.shape[0] - 1 - (centres[:, 1] - lattice.north0_m) / lattice.size_m
        np.testing.assert_allclose(rows, from_north + 0.5, atol=0.01)


def test_enough_and_small_gaps(cli: Cli, torn: Path) -> None:
    everything = cli("gaps", torn, "--json").document
    enough = cli("gaps", torn, "--target", 0.985, "--force", "--json").document
    assert enough["path_length_m"] < everything["path_length_m"]
    assert enough["coverage_after"] >= 0.985
    nothing = cli("gaps", torn, "--min-area", 1e9, "--force", "--json").document
    assert nothing["mission"] is None
    said = cli("gaps", torn, "--target", 0.5, "--force", code=0).out
    assert "no gaps to close" in said
    assert "gaps contains the mission for earlier gaps; do not fly it again" in said


def test_an_older_gap_mission_is_not_overwritten(cli: Cli, torn: Path) -> None:
    cli("gaps", torn, code=0)
    ended = cli("gaps", torn, code=2)
    assert "--force" in ended.error or "--force" in ended.err
    cli("gaps", torn, "--force", code=0)


def test_what_to_run_next_is_a_suggestion_as_of_other_commands(cli: Cli, torn: Path) -> None:
    """It was put behind the names of the written files."""
    own = torn / "gaps"
    *_, written, upload, fly, verify = cli("gaps", torn).out.splitlines()
    assert written == f"wrote {torn / 'gaps.geojson'}, {torn / 'gap_mission.waypoints'}"
    assert upload == f"Next: uavcover plan-upload {own} --to URL"
    assert fly == f"      uavcover fly {own} --to URL"
    assert verify == f"      uavcover verify {torn} --log {torn / 'track.csv'} --log {own / 'track.csv'}"


def broken_off(run: Path, fraction: float) -> dict[str, str]:
    """End the track after this share of its samples; the last row."""
    lines = (run / "track.csv").read_text().splitlines()
    kept = lines[: 1 + round(fraction * (len(lines) - 1))]
    (run / "track.csv").write_text("\n".join(kept) + "\n")
    return dict(zip(kept[0].split(","), kept[-1].split(","), strict=True))


def test_a_gap_mission_from_where_the_vehicle_is(cli: Cli, flown: Path) -> None:
    last = broken_off(flown, 0.55)
    sealed(flown)
    from_home = cli("gaps", flown, "--json").document
    ended = cli("gaps", flown, "--start", "last", "--force", "--json", code=0)
    assert (from_home["start"], ended.document["start"]) == ("home", "last")
    assert "--in-flight" in ended.err
    assert f"uavcover fly {flown / 'gaps'} --resume --to URL" in ended.err
    assert ended.document["coverage_after"] > 0.99
    assert ended.document["path_length_m"] < from_home["path_length_m"]

    loader = mavwp.MAVWPLoader()
    loader.load(str(flown / "gap_mission.waypoints"))
    home, *items = [loader.wp(k) for k in range(loader.count())]
    commands = [item.command for item in items]
    assert 22 not in commands, "a vehicle in the air does not take off"
    assert (commands[-1], commands.count(21)) == (21, 1)
    positions = np.array([(item.x, item.y, item.z + home.z) for item in items if item.command == 16])
    np.testing.assert_allclose(positions[0, :2], [float(last["lat_deg"]), float(last["lon_deg"])], atol=2e-7)
    assert positions[0, 2] >= float(last["alt_amsl_m"]) - 0.01, "straight up, if at all"

    site, _ = route_of(flown)
    assert site.frame is not None
    corners = site.frame.enu_from_geodetic(*positions.T)
    fractions = np.linspace(0.0, 1.0, 200)[:, None]
    legs = np.concatenate([a + fractions * (b - a) for a, b in itertools.pairwise(corners)])
    limits = site.scenario.limits
    above_m = legs[:, 2] - site.ground.heights_m(legs[:, :2])
    assert above_m.min() >= min(limits.transit_clearance_m, limits.min_height_agl_m) - 0.01
    assert shapely.covers(site.fence, shapely.points(legs[:, :2])).all()
    # The folder holds the same route from home.
    assert 22 in [
        int(row.split("\t")[3]) for row in (flown / "gaps" / "mission.waypoints").read_text().splitlines()[1:]
    ]


def test_no_mission_in_the_air_for_a_vehicle_on_the_ground(cli: Cli, torn: Path) -> None:
    assert "m above ground" in cli("gaps", torn, "--start", "last", code=4).err
    assert "gap_mission.waypoints" not in files(torn)
    assert "--start: must be home or last, not 'here'" in cli("gaps", torn, "--start", "here", code=2).error


@pytest.mark.parametrize(("option", "value"), [("--target", 1.5), ("--target", 0.0), ("--min-area", -1.0)])
def test_arguments_out_of_range(cli: Cli, torn: Path, option: str, value: float) -> None:
    assert str(value) in cli("gaps", torn, option, value, code=2).err
    assert "gaps" not in files(torn)


def test_gaps_of_nothing_flown(cli: Cli, planned: Path) -> None:
    assert "uavcover fly" in cli("gaps", planned, code=2).error
