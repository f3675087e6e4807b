"""Where vehicles are, as their scenario says."""

import dataclasses
import json
from pathlib import Path

import pytest

from tests.planning.sites import make_site
from tests.scenario.scenario_texts import GOOD, parse, refused
from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.run.own_links import links_of_run, links_of_scenario
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.vehicle_site import vehicle_scenario

ONE, OTHER = 'link = "udpin://127.0.0.1:14550"\n', 'link = "udpin://127.0.0.1:14560"\n'
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
    own = ["udpin://127.0.0.1:14550", "udpin://127.0.0.1:14560"]
    assert links_of_scenario(source, None, sortie=None) == own
    assert links_of_scenario(source, [], sortie=None) == own  # as the command line says none
    assert links_of_scenario(source, ["mock:", "mock:"], sortie=None) == ["mock:", "mock:"]
    assert links_of_scenario(source, ["mock:"], sortie=2) == ["mock:"]
    for given in (["mock:"], ["mock:"] * 3):
        with pytest.raises(
            InputError, match=rf"--to: is given {len(given)} times, and .* lists 2 vehicles that differ"
        ):
            links_of_scenario(source, given, sortie=None)
    one = scenario_file(tmp_path, VEHICLE + ONE)
    assert links_of_scenario(one, None, sortie=None) == own[:1]


def test_a_missing_link_is_named(tmp_path: Path) -> None:
    source = scenario_file(tmp_path, f"[[vehicle]]\n{ONE}[[vehicle]]\n")
    with pytest.raises(InputError, match=r"--to: is missing, and \[\[vehicle\]\] number 2 has no link; give --to for"):
        links_of_scenario(source, None, sortie=None)
    with pytest.raises(InputError, match=r"--to: is missing, and \[vehicle\] has no link"):
        links_of_scenario(scenario_file(tmp_path, VEHICLE), None, sortie=None)
    alike = VEHICLE + ONE + "[fleet]\nvehicles = 2\n"
    with pytest.raises(InputError, match=r"\[vehicle\] has one link for 2 vehicles"):
        links_of_scenario(scenario_file(tmp_path, alike), None, sortie=None)


def test_a_flight_is_at_the_link_of_its_vehicle(tmp_path: Path) -> None:
    fleet = parse(Path(scenario_file(tmp_path, f"[[vehicle]]\n{ONE}[[vehicle]]\n{OTHER}")).read_text())
    run = run_of(tmp_path / "run", dump_scenario(fleet), fleet={"vehicles": 2})
    site = make_site(home=(0.0, 0.0))
    site = dataclasses.replace(site, scenario=fleet)
    for number in (1, 2):
        run_of(run.path / f"sortie-{number}", dump_scenario(vehicle_scenario(site, number)), fleet=None)
    assert len(links_of_run(run, None, sortie=None)) == 2
    assert links_of_run(run, ["mock:"], sortie=None) == ["mock:"]
    assert links_of_run(run, None, sortie=2) == ["udpin://127.0.0.1:14560"]
    assert links_of_run(RunFolder(run.path / "sortie-1"), None, sortie=None) == ["udpin://127.0.0.1:14550"]
    gaps = run_of(run.path / "gaps", dump_scenario(fleet), fleet=None)
    assert links_of_run(gaps, None, sortie=None) == ["udpin://127.0.0.1:14550"]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            f"[[vehicle]]\n{ONE}[[vehicle]]\n{OTHER}[[vehicle]]\n{ONE}",
            "is that of vehicle.0; each vehicle needs a link of its own",
        ),
        (f"[[vehicle]]\nlink = 3\n[[vehicle]]\n{OTHER}", "vehicle.0.link: must be text in quotes, not 3"),
        ('[[vehicle]]\n[[vehicle]]\nlink = "udpin:/127"\n', "vehicle.1.link: 'udpin:/127' has no port"),
        ('[[vehicle]]\n[[vehicle]]\nlink = ""\n', "vehicle.1.link: "),
        ('[vehicle]\nlink = "carrier-pigeon://1"\n', "vehicle.link: "),
    ],
)
def test_links_that_cannot_be(tables: str, words: str) -> None:
    assert words in refused(text=GOOD.replace(VEHICLE, tables))


def test_mocks_may_have_the_same_link() -> None:
    tables = '[[vehicle]]\nlink = "mock:"\n[[vehicle]]\nlink = "mock:"\nendurance_s = 900.0\n'
    assert [v.link for v in parse(GOOD.replace(VEHICLE, tables)).vehicles] == ["mock:", "mock:"]
