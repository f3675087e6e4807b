import csv
import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import pytest

from uavcover.errors import InputError
from uavcover.model.route import Plan, Route, RouteMember, RouteMetrics
from uavcover.planner.pareto_file import PARETO_COLUMNS, TradeOffAxis, pareto_csv, read_pareto, trade_off_axis
from uavcover.run.documents import plan_document, read_plan_document
from uavcover.run.folder import json_text
from uavcover.scenario.site import Site, load_site


@pytest.fixture(scope="module")
def site() -> Site:
    return load_site("jacksboro")


def member(coverage: float) -> RouteMember:
    points = np.array([[100.0 / 3.0, 20.0, 300.0], [-400.0, 500.0, 350.0]])
    return RouteMember(
        Route(points), RouteMetrics(coverage, coverage / 0.9, 2, 650.1, 65.0, 41.0, 99.0, 650.1), 0.0, "imodbo"
    )


def make_plan() -> Plan:
    members = (member(0.1 + 0.2), member(0.9))
    return Plan(members[1], members, (member(0.5),), "knee", True, "imodbo", 40, 1.5)


def test_plan_document_has_every_key_and_reads_back(site: Site) -> None:
    plan = make_plan()
    document = json.loads(json_text(plan_document(site, plan, seed=4, bounds={"coverable_fraction": 1.0})))
    assert set(document) >= {
        "schema_version", "name", "seed", "algorithm", "evaluations", "wall_s", "origin", "waypoints", "metrics", "bounds",
        "baselines",
    }  # fmt: skip
    assert set(document["waypoints"][0]) == {
        "east_m", "north_m", "up_m", "lat_deg", "lon_deg", "alt_amsl_m", "height_agl_m",
    }  # fmt: skip
    assert document["metrics"]["coverage_fraction"] == 0.9
    assert document["baselines"][0]["coverage_fraction"] == 0.5
    read = read_plan_document(document, source="plan.json")
    assert (read.route.waypoints_m == plan.chosen.route.waypoints_m).all()
    assert (read.coverage_fraction, read.rule_met) == (0.9, True)


def test_waypoints_agree_with_themselves(site: Site) -> None:
    document = plan_document(site, make_plan(), seed=4, bounds={})
    assert site.frame is not None
    for w in document["waypoints"]:
        back = site.frame.enu_from_geodetic(w["lat_deg"], w["lon_deg"], w["alt_amsl_m"])[0]
        np.testing.assert_allclose(back, [w["east_m"], w["north_m"], w["up_m"]], atol=1e-6)
        height_agl_m = site.ground.heights_agl_m(np.array([[w["east_m"], w["north_m"], w["up_m"]]]))[0]
        assert w["height_agl_m"] == pytest.approx(float(height_agl_m), abs=1e-6)


def test_without_a_place_on_earth() -> None:
    document = plan_document(load_site("paper-R2"), make_plan(), seed=1, bounds={})
    assert document["origin"] is None
    assert document["waypoints"][0]["lat_deg"] is None


def test_pareto_csv_is_unrounded_and_marks_the_choice() -> None:
    rows = list(csv.DictReader(io.StringIO(pareto_csv(make_plan()))))
    assert tuple(rows[0]) == PARETO_COLUMNS
    assert [row["index"] for row in rows] == ["0", "1"]
    assert [row["chosen"] for row in rows] == ["0", "1"]
    assert float(rows[0]["coverage_fraction"]) == 0.1 + 0.2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("schema_version", 2), ("waypoints", None), ("waypoints", [{"east_m": 1.0}]), ("metrics", {}),
        ("waypoints", [{"east_m": "x", "north_m": 1, "up_m": 2}]),
        ("waypoints", [{"east_m": None, "north_m": 1, "up_m": 2}]),
    ],
)  # fmt: skip
def test_what_is_no_plan(site: Site, key: str, value: object) -> None:
    document = plan_document(site, make_plan(), seed=4, bounds={})
    with pytest.raises(InputError, match=r"^here: "):
        read_plan_document({**document, key: value}, source="here")


def test_the_trade_off_is_drawn_against_time_where_every_route_has_one(tmp_path: Path) -> None:
    plan = make_plan()
    file = tmp_path / "pareto.csv"
    file.write_text(pareto_csv(plan))
    without = read_pareto(file)
    baselines = [dataclasses.asdict(b.metrics) for b in plan.baselines]
    assert [row.mission_time_s for row in without] == [None, None]
    assert trade_off_axis(without, baselines) == TradeOffAxis("route length, km", False, (0.6501, 0.6501), (0.6501,))
    timed = [dataclasses.replace(row, mission_time_s=90.0 + row.index) for row in without]
    assert trade_off_axis(timed, baselines).label == "route length, km", "one baseline has no time"
    baselines[0]["mission_time_s"] = 120.0
    assert trade_off_axis(timed, baselines) == TradeOffAxis("mission time, minutes", True, (1.5, 91 / 60), (2.0,))
    used = [dataclasses.replace(row, mission_energy_hover_s=60.0) for row in timed]
    baselines[0]["mission_energy_hover_s"] = 180.0
    assert trade_off_axis(used, baselines, "energy") == TradeOffAxis(
        "mission energy, minutes of hovering", True, (1.0, 1.0), (3.0,)
    )
    assert trade_off_axis(used, baselines, "mission-time").members == (1.5, 91 / 60)


def test_a_pareto_set_of_an_older_version_is_read(tmp_path: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(pareto_csv(make_plan()))))
    out = io.StringIO()
    columns = [name for name in PARETO_COLUMNS if not name.startswith("mission_")]
    writer = csv.DictWriter(out, columns, extrasaction="ignore")
    writer.writeheader()
    writer.writerows(rows)
    (tmp_path / "pareto.csv").write_text(out.getvalue())
    assert [row.mission_time_s for row in read_pareto(tmp_path / "pareto.csv")] == [None, None]


def test_mission_time_is_read_back_unrounded(tmp_path: Path) -> None:
    plan = make_plan()
    timed = dataclasses.replace(
        plan.chosen,
        metrics=dataclasses.replace(plan.chosen.metrics, mission_time_s=100.0 / 3.0, mission_energy_hover_s=70.0 / 3.0),
    )
    (tmp_path / "pareto.csv").write_text(pareto_csv(dataclasses.replace(plan, chosen=timed, members=(timed,))))
    assert [row.mission_time_s for row in read_pareto(tmp_path / "pareto.csv")] == [100.0 / 3.0]
    assert [row.mission_energy_hover_s for row in read_pareto(tmp_path / "pareto.csv")] == [70.0 / 3.0]
