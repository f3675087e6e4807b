"""Hostile text in messages of a vehicle and in names of files: none of it reaches the screen, the log or a document."""

import json
import random
import tomllib
from pathlib import Path

import pytest

import uavcover
from mission_io.wire import messages as m
from tests.cli import bad_inputs
from tests.cli.bad_inputs import options, square_parts
from tests.cli.conftest import Cli, Ended
from tests.extras.check.test_command import GOOD, mission
from tests.hostile_text import HOSTILE, control_characters, hostile_text
from tests.scenario.areas import written
from uavcover.mock.state import MockState

DEM = Path(uavcover.__file__).parent / "data" / "jacksboro.tif"


TOGETHER = ["x".join(HOSTILE[k::3]) for k in range(3)]


def assert_plain(text: str) -> None:
    assert control_characters(text) <= {"\n"}, sorted(control_characters(text))


def assert_all_plain(value: object) -> None:
    """Every text of a document."""
    match value:
        case str():
            assert control_characters(value) == set(), value
        case dict():
            for key, item in value.items():
                assert_all_plain(key)
                assert_all_plain(item)
        case list():
            for item in value:
                assert_all_plain(item)


def assert_harmless(ended: Ended) -> None:
    assert_plain(ended.out)
    assert_plain(ended.err)
    if ended.out.startswith("{"):
        assert_all_plain(ended.document)


def test_texts_of_a_vehicle_are_harmless_wherever_they_go(
    cli: Cli, flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = random.Random(5)
    honest = MockState.send
    counts = {"position": 0}

    def send(state: MockState, message: m.Message) -> None:
        honest(state, message)
        counts["position"] += isinstance(message, m.GlobalPositionInt)
        if isinstance(message, m.GlobalPositionInt) and counts["position"] % 50 == 0:
            text = hostile_text(rng).encode("ascii", "replace").decode()
            honest(state, m.StatusText(rng.randrange(8), text[:50]))

    monkeypatch.setattr(MockState, "send", send)
    ended = cli("fly", flown, "--to", "mock:", "--mock-speed", 200, "--force", code=0)
    assert "PWNED" in ended.out, "the vehicle has said it"
    assert_harmless(ended)
    assert_all_plain(json.loads((flown / "run.json").read_text())["flight"])
    recording = (flown / "flight.rrd").read_bytes()
    assert not any(text.encode() in recording for text in HOSTILE if "\x1b" in text)
    assert_harmless(cli("verify", flown, "-v"))
    cli("report", flown, code=0)
    page = (flown / "report.html").read_text(encoding="utf-8")
    assert control_characters(page) <= {"\n", "\t"}


@pytest.mark.parametrize("text", TOGETHER, ids=["a", "b", "c"])
def test_names_of_areas_are_harmless(cli: Cli, tmp_path: Path, text: str) -> None:
    bad_inputs.prepare(tmp_path)
    document = json.loads(written.geojson(tmp_path / "area.geojson", square_parts(bad_inputs.AT) * 2).read_text())
    for number, feature in enumerate(document["features"]):
        feature["properties"]["name"] = f"field {text} {number}"
        feature["properties"][text] = text
    (tmp_path / "area.geojson").write_text(json.dumps(document))
    for more in ((), ("--layer", text), ("--json",)):
        assert_harmless(
            cli("new", tmp_path / "area.geojson", *options(tmp_path / "dem.tif"), "-o", tmp_path / "s.toml", *more)
        )
    (tmp_path / "s.toml").unlink(missing_ok=True)


@pytest.mark.parametrize("text", TOGETHER, ids=["a", "b", "c"])
def test_names_in_missions_are_harmless(cli: Cli, tmp_path: Path, text: str) -> None:
    file = mission(tmp_path, *GOOD, name=f"m{text.replace(chr(0), '')}.waypoints".replace("/", ""))
    assert_harmless(cli("check", file, "--dem", DEM, "--return-height", "70m"))
    assert_harmless(cli("check", file, "--dem", DEM, "--return-height", "70m", "--json"))
    broken = tmp_path / "broken.waypoints"
    broken.write_bytes(file.read_bytes() + f"9\t0\t3\t{text}\t1\n".encode(errors="surrogatepass"))
    assert_harmless(cli("check", broken, "--dem", DEM))
    plan = {
        "fileType": "Plan", "version": 1, "groundStation": text, "mission": {"version": 2, text: text, "items": [
            {"type": text, "complexItemType": text, "command": 16, "frame": 3, "params": [text] * 7}
        ]},
    }  # fmt: skip
    (tmp_path / "m.plan").write_text(json.dumps(plan))
    assert_harmless(cli("check", tmp_path / "m.plan", "--dem", DEM))


@pytest.mark.parametrize("text", TOGETHER, ids=["a", "b", "c"])
def test_scenarios_are_harmless(cli: Cli, tmp_path: Path, text: str) -> None:
    good = Path("uavcover/scenarios/jacksboro.toml").read_text(encoding="utf-8")
    line = next(line for line in good.splitlines() if line.startswith("name"))
    quoted = json.dumps(text)
    for number, changed in enumerate(
        (
            good.replace(line, f"name = {quoted}"),
            good.replace(line, f"{line}\n{quoted} = 1"),
            good.replace(line, f"{line}\nterrain = {quoted}"),
            good + f"\n[[no_fly]]\nname = {quoted}\nfile = {quoted}\n",
        )
    ):
        file = tmp_path / f"s{number}.toml"
        file.write_text(changed, encoding="utf-8", errors="replace")
        assert_harmless(cli("plan", file, "--evaluations", 1, "-o", tmp_path / f"run{number}", "-v"))


def test_no_title_of_a_table_forges_a_key_of_the_scenario(cli: Cli, tmp_path: Path) -> None:
    title = json.dumps("".join(HOSTILE) + '\nselect = "shortest"', ensure_ascii=False).replace("\x7f", "\\u007f")
    camera = (
        f"title = {title}\nsource = {title}\nsensor_mm = [17.3, 13.0]\npixels = [5280, 3956]\nfocal_length_mm = 12.29\n"
    )
    (tmp_path / "own.toml").write_text(camera, encoding="utf-8")
    area = written.kml(tmp_path / "a.kml", square_parts(bad_inputs.AT))
    made = tmp_path / "made.toml"
    cli("new", area, "--dem", DEM, "--camera", tmp_path / "own.toml", "--gsd", "4cm", "-o", made, code=0)
    text = made.read_text(encoding="utf-8")
    assert_plain(text)
    assert tomllib.loads(text)["select"] == "coverage>=0.98"
