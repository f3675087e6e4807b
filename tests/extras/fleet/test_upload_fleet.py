"""Each vehicle of a fleet gets its first sortie, and none gets anything when one of them is not as it should be."""

import dataclasses
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.extras.fleet.test_fleet import Listener
from uavcover.errors import InputError, VehicleError
from uavcover.extras.fleet import command as module
from uavcover.extras.fleet.command import first_sorties, upload_fleet
from uavcover.flight.connect import Connected, VehicleLink, connect
from uavcover.missions.flights import compile_flights
from uavcover.missions.objectives import judge
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.vehicle import Fleet
from uavcover.planner.plan_files import fleet_document, save_plan
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.site_maps import judging_map

LINK = VehicleLink(url="mock:")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Lines over the demo's ground, planned for two vehicles."""
    scenario = dataclasses.replace(load_scenario("jacksboro"), fleet=Fleet(vehicles=2, start_error_s=1.0))
    site = load_site(scenario)
    corners = [(e, 100.0 * k) for k in range(5) for e in ((-900.0, -100.0), (-100.0, -900.0))[k % 2]]
    route = Route(lay_over_terrain(site, np.array(corners), np.full(len(corners), 80.0), tolerance_m=8.0))
    member = RouteMember(route, judge(judging_map(site), route), 0.0, "test")
    plan = Plan(member, (member,), (), "knee", True, "test", 1, 0.0)
    flights = compile_flights(site, route)
    run = RunFolder(tmp_path_factory.mktemp("fleet"))
    save_plan(
        run, site, plan, compiled=None, autopilot="ardupilot", seed=1, command=["test"], sorties=flights,
        fleet=fleet_document(site, flights),
    )  # fmt: skip
    return run.path


def test_each_vehicle_gets_its_first_sortie(folder: Path) -> None:
    run, user = RunFolder(folder), Listener()
    documents = upload_fleet(run, [LINK, LINK], user)
    rows = json.loads(run.file("plan.json").read_text())["fleet"]["by_vehicle"]
    assert [d["sortie"] for d in documents] == [row["sorties"][0] for row in rows]
    assert [d["vehicle"] for d in documents] == [1, 2]
    assert all(d["passed"] for d in documents)
    for document in documents:
        own = json.loads(run.file(f"sortie-{document['sortie']}/upload.json").read_text())
        assert {**json.loads(json.dumps(document)), **own} == json.loads(json.dumps(document))
        sent = next(part for part in own["lists"] if part["mission_type"] == "mission")["sent"]
        lines = run.file(f"sortie-{document['sortie']}/mission.waypoints").read_text().splitlines()
        assert len(sent) == len(lines) - 1
    assert [line.split()[:4] for line in user.lines[-2:]] == [
        ["vehicle", str(d["vehicle"]), "sortie", str(d["sortie"])] for d in documents
    ]


@pytest.mark.parametrize("wrong", ["armed", "elsewhere", "silent"])
def test_nothing_is_sent_when_the_second_is_not_ready(
    folder: Path, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[str] = []
    observed = 0

    @contextmanager
    def second_is_wrong(*arguments: Any) -> Iterator[Connected]:
        nonlocal observed
        observed += 1
        if observed == 2 and wrong == "silent":
            raise VehicleError("nobody answers")
        with connect(*arguments) as vehicle:
            if observed == 2 and wrong == "armed":
                armed = dataclasses.replace(vehicle.client.vehicle, armed=True)
                yield dataclasses.replace(vehicle, client=SimpleNamespace(vehicle=armed))
            else:
                yield vehicle

    def check_home(*_: Any) -> None:
        if observed == 2 and wrong == "elsewhere":
            raise VehicleError("its home is elsewhere")

    monkeypatch.setattr(module, "connect", second_is_wrong)
    monkeypatch.setattr(module, "check_home", check_home)
    monkeypatch.setattr(module, "require_multirotor", lambda _: None)
    monkeypatch.setattr(module, "send_and_compare", lambda *_, **__: sent.append("sent"))
    user = Listener()
    words = {"armed": "the vehicle is armed", "elsewhere": "its home is elsewhere", "silent": "nobody answers"}[wrong]
    with pytest.raises(VehicleError, match=words):
        upload_fleet(RunFolder(folder), [LINK, LINK], user)
    assert sent == []
    assert "vehicle 2 at mock: is not ready; no mission was uploaded to any vehicle" in user.lines


def test_who_holds_a_sortie_is_told_when_an_upload_fails(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def send(*_: Any, **__: Any) -> dict[str, Any]:
        calls.append("sent")
        if len(calls) == 2:
            raise VehicleError("the link is gone")
        return {"passed": True, "url": "mock:"}

    monkeypatch.setattr(module, "send_and_compare", send)
    user = Listener()
    with pytest.raises(VehicleError, match="the link is gone"):
        upload_fleet(RunFolder(folder), [LINK, LINK], user)
    assert "vehicle 2: the upload failed; vehicles that have their sortie: 1" in user.lines


def test_more_vehicles_than_the_plan_has(folder: Path) -> None:
    with pytest.raises(
        InputError, match=r"the plan is for 2 vehicles, but --to is given 3 times; plan again with: .* --vehicles 3"
    ):
        first_sorties(RunFolder(folder), 3)


def test_fewer_vehicles_fly_than_the_plan_has(folder: Path, tmp_path: Path) -> None:
    document = json.loads((folder / "plan.json").read_text())
    document["fleet"]["vehicles"] = 5
    (tmp_path / "plan.json").write_text(json.dumps(document))
    (tmp_path / "sortie-1").mkdir()
    (tmp_path / "sortie-1" / "plan.json").write_text("{}")
    with pytest.raises(
        InputError, match=r"the plan is for 2 vehicles, .*; more vehicles would not finish sooner; use --to 2 times"
    ):
        first_sorties(RunFolder(tmp_path), 3)
