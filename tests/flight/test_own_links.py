"""Where vehicles are, as their scenario says, and the ground station that an ArduPilot minds."""

import contextlib
import dataclasses
import json
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.links.simulated import Conditions
from tests.flight.scene import make_scene, mission
from tests.flight.test_limits import the_plan
from tests.planner.sites import make_site
from tests.scenario.scenario_texts import GOOD, parse, refused
from uavcover.errors import InputError
from uavcover.flight.connect import VehicleAddress, given_addresses, links_of_run, links_of_scenario, require_different
from uavcover.flight.monitor import open_vehicle
from uavcover.model.track import Ending, EventKind, FlightFailedError
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.vehicles import vehicle_scenario

ONE, OTHER = 'link = "udpin://127.0.0.1:14550"\n', 'link = "udpin://127.0.0.1:14560"\n'
MOCK = VehicleAddress("mock:")
VEHICLE = "[vehicle]\ncruise_speed_m_s = 10.0\n"


def scenario_file(folder: Path, tables: str) -> str:
    path = folder / "field.toml"
    path.write_text(GOOD.replace(VEHICLE, tables).replace('"dem.tif"', '"bundled:jacksboro.tif"'))
    return str(path)


def run_of(folder: Path, text: str, *, fleet: object) -> RunFolder:
    run = RunFolder(folder)
    folder.mkdir(exist_ok=True)
    (folder / "scenario.toml").write_text(text)
    (folder / "plan.json").write_text(json.dumps({"fleet": fleet}))
    return run


def test_links_of_all_vehicles_in_their_order(tmp_path: Path) -> None:
    source = scenario_file(tmp_path, f"[[vehicle]]\n{ONE}[[vehicle]]\n{OTHER}")
    own = [VehicleAddress("udpin://127.0.0.1:14550"), VehicleAddress("udpin://127.0.0.1:14560")]
    assert links_of_scenario(source, [], sortie=None) == own
    assert links_of_scenario(source, [MOCK, MOCK], sortie=None) == [MOCK, MOCK]
    assert links_of_scenario(source, [MOCK], sortie=2) == [MOCK]
    for given in ([MOCK], [MOCK] * 3):
        with pytest.raises(
            InputError, match=rf"--to is given {len(given)} times?, but .* defines 2 different vehicles"
        ):
            links_of_scenario(source, given, sortie=None)
    one = scenario_file(tmp_path, VEHICLE + ONE)
    assert links_of_scenario(one, [], sortie=None) == own[:1]


def test_a_missing_link_is_named(tmp_path: Path) -> None:
    source = scenario_file(tmp_path, f"[[vehicle]]\n{ONE}[[vehicle]]\n")
    with pytest.raises(InputError, match=r"--to is missing, and \[\[vehicle\]\] number 2 has no link; use --to for"):
        links_of_scenario(source, [], sortie=None)
    with pytest.raises(InputError, match=r"--to is missing, and \[vehicle\] has no link"):
        links_of_scenario(scenario_file(tmp_path, VEHICLE), [], sortie=None)
    alike = VEHICLE + ONE + "[fleet]\nvehicles = 2\n"
    with pytest.raises(InputError, match=r"\[vehicle\] has one link for 2 vehicles"):
        links_of_scenario(scenario_file(tmp_path, alike), [], sortie=None)


def test_a_flight_is_at_the_link_of_its_vehicle(tmp_path: Path) -> None:
    fleet = parse(Path(scenario_file(tmp_path, f"[[vehicle]]\n{ONE}[[vehicle]]\n{OTHER}")).read_text())
    run = run_of(tmp_path / "run", dump_scenario(fleet), fleet={"vehicles": 2})
    site = make_site(home=(0.0, 0.0))
    site = dataclasses.replace(site, scenario=fleet)
    for number in (1, 2):
        run_of(run.path / f"sortie-{number}", dump_scenario(vehicle_scenario(site, number)), fleet=None)
    assert len(links_of_run(run, [], sortie=None)) == 2
    assert links_of_run(run, [MOCK], sortie=None) == [MOCK]
    assert links_of_run(run, [], sortie=2) == [VehicleAddress("udpin://127.0.0.1:14560")]
    assert links_of_run(RunFolder(run.path / "sortie-1"), [], sortie=None) == [
        VehicleAddress("udpin://127.0.0.1:14550")
    ]
    gaps = run_of(run.path / "gaps", dump_scenario(fleet), fleet=None)
    assert links_of_run(gaps, [], sortie=None) == [VehicleAddress("udpin://127.0.0.1:14550")]


def test_one_link_with_a_system_for_each_vehicle(tmp_path: Path) -> None:
    source = scenario_file(tmp_path, f"[[vehicle]]\n{ONE}system_id = 4\n[[vehicle]]\n{ONE}system_id = 7\n")
    radio = "udpin://127.0.0.1:14550"
    assert links_of_scenario(source, [], sortie=None) == [VehicleAddress(radio, 4), VehicleAddress(radio, 7)]
    assert given_addresses([radio], [4, 7]) == [VehicleAddress(radio, 4), VehicleAddress(radio, 7)]
    assert given_addresses([radio, radio, "mock:"], [4, 7, 1])[1:] == [
        VehicleAddress(radio, 7),
        VehicleAddress("mock:", 1),
    ]
    assert given_addresses(["udp:127.0.0.1:1", "udp:127.0.0.1:2"], [5]) == [
        VehicleAddress("udp:127.0.0.1:1", 5), VehicleAddress("udp:127.0.0.1:2", 5),
    ]  # fmt: skip
    assert given_addresses([radio], None) == [VehicleAddress(radio)]
    assert given_addresses(None, None) == given_addresses([], [5]) == []


@pytest.mark.parametrize(
    ("urls", "systems", "words"),
    [
        (["udp::1", "udp::2"], [1, 2, 3], "--system is given 3 times, but --to 2 times"),
        ([], [1, 2], "--system selects a vehicle on a link; specify the link with --to"),
        (["udp::1"], [4, 4], "--system: 4 at udp::1 is used twice"),
        (["udp::1", "udp::1"], [], "--to: udp::1 is used 2 times; each vehicle needs its own link, or its own --system"),
        (["udp::1", "udp::1"], [3], "--system: 3 at udp::1 is used twice"),
    ],
)  # fmt: skip
def test_places_that_do_not_fit(urls: list[str], systems: list[int], words: str) -> None:
    with pytest.raises(InputError, match=words):
        given_addresses(urls, systems)


def test_vehicles_at_one_place() -> None:
    udp = VehicleAddress("udp:127.0.0.1:1")
    require_different([MOCK, MOCK, udp])
    with pytest.raises(InputError, match=r"--to: udp:127\.0\.0\.1:1 is used 2 times"):
        require_different([udp, MOCK, udp])
    with pytest.raises(InputError, match=r"--to: udp:127\.0\.0\.1:1 is used 2 times"):
        require_different([udp, udp._replace(system_id=2)])


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            f"[[vehicle]]\n{ONE}[[vehicle]]\n{OTHER}[[vehicle]]\n{ONE}",
            "is already used by vehicle.0; each vehicle needs its own link",
        ),
        (
            f"[[vehicle]]\n{ONE}system_id = 3\n[[vehicle]]\n{ONE}",
            "vehicle.1.link: udpin://127.0.0.1:14550 is already used by vehicle.0; each vehicle needs its own",
        ),
        (
            f"[[vehicle]]\n{ONE}system_id = 3\n[[vehicle]]\n{ONE}system_id = 3\nendurance_s = 900.0\n",
            "vehicle.1.system_id: 3 at udpin://127.0.0.1:14550 is already used by vehicle.0",
        ),
        ("[vehicle]\nsystem_id = 256\n", "system_id: must be between 1 and 255, not 256"),
        (f"[[vehicle]]\nlink = 3\n[[vehicle]]\n{OTHER}", "vehicle.0.link: must be text in quotes, not 3"),
        (
            '[[vehicle]]\n[[vehicle]]\nlink = "udpin:/127"\n',
            "vehicle.1.link: 'udpin:/127' does not end in a colon and a port",
        ),
        ('[[vehicle]]\n[[vehicle]]\nlink = ""\n', "vehicle.1.link: "),
        ('[vehicle]\nlink = "carrier-pigeon://1"\n', "vehicle.link: "),
    ],
)
def test_links_that_cannot_be(tables: str, words: str) -> None:
    assert words in refused(text=GOOD.replace(VEHICLE, tables))


def test_mocks_may_have_the_same_link() -> None:
    tables = '[[vehicle]]\nlink = "mock:"\n[[vehicle]]\nlink = "mock:"\nendurance_s = 900.0\n'
    assert [v.link for v in parse(GOOD.replace(VEHICLE, tables)).vehicles] == ["mock:", "mock:"]


def enforcing(number: int = 250, **options):
    scene = make_scene(ARDUPILOT, **options)
    scene.upload(mission())
    scene.vehicle.parameters.put("MAV_GCS_SYSID", float(number))
    scene.vehicle.parameters.put("MAV_OPTIONS", 1.0)
    return scene


def test_a_vehicle_that_minds_another_station_is_refused_with_what_to_do():
    with pytest.raises(FlightFailedError) as caught:
        enforcing().fly()
    assert caught.value.outcome.ending is Ending.NOT_ARMED
    text = str(caught.value)
    assert "vehicle 1 sends heartbeats, but does not answer this program (system 255); it may accept only" in text
    assert "set --own-system to its MAV_GCS_SYSID" in text
    assert "--yes" not in text


def test_with_its_number_the_mission_is_flown():
    scene = enforcing()
    scene.client, scene.monitor = open_vehicle(scene.link, own_system=250)
    assert scene.fly().ending is Ending.LANDED


def test_a_station_that_is_not_minded_is_told_that_its_silence_does_not_count():
    scene = enforcing()
    scene.vehicle.parameters.put("MAV_OPTIONS", 0.0)
    scene.vehicle.parameters.put("FS_GCS_ENABLE", 1.0)
    plan = dataclasses.replace(the_plan(), needs=None)
    with contextlib.suppress(FlightFailedError):  # the vehicle returns: it has not heard its own station since
        scene.fly(plan=plan)
    assert any("(MAV_GCS_SYSID), planned 255" in text for text in scene.reported(EventKind.WARNING))


def test_a_bad_link_is_no_deaf_vehicle():
    scene = make_scene(ARDUPILOT, conditions=Conditions(delay_s=0.1, loss=0.2))
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED
