"""Large, deep and hostile files: an answer in proportion to the size, and one error where there is one to give."""

import json
import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mission_io.errors import FormatError
from mission_io.formats import plan, wpl
from mission_io.formats.csv_tables import HEADER, read_csv
from mission_io.formats.drawings import read_area_list, read_geojson
from mission_io.formats.map_xml import read_kml_drawing
from mission_io.formats.text import text_from_bytes
from scripts.attack import fuzz_formats
from scripts.attack.fuzz_files import of_text
from scripts.attack.fuzz_formats import TARGETS, fuzz_by_mutations, mutated
from tests.mission_io.formats.samples import HOME, MISSION

ROW = "{}\t0\t3\t16\t0\t0\t0\t0\t33.2191234\t-98.1240001\t60.25\t1\n"


def rows(count: int) -> str:
    return "QGC WPL 110\n" + "".join(ROW.format(n) for n in range(count))


def item(number: int) -> str:
    return (
        f'{{"type": "SimpleItem", "command": 16, "frame": 3, "autoContinue": true, "doJumpId": {number},'
        ' "params": [0, 0, 0, null, 33.2, -98.1, 60.25], "Altitude": 60.25, "AltitudeMode": 1, "AMSLAltAboveTerrain": null}'
    )


def plan_of(items: str) -> str:
    home = json.dumps([HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m])
    return (
        '{"fileType": "Plan", "version": 1, "geoFence": {"version": 2}, "rallyPoints": {"version": 2, "points": []},'
        f' "mission": {{"version": 2, "firmwareType": 3, "plannedHomePosition": {home}, "items": [{items}]}}}}'
    )


def points(count: int) -> str:
    return " ".join(f"{n / count},{n * n / count / count},0" for n in range(count))


SIZES: dict[str, tuple[Callable[[str], object], Callable[[int], str]]] = {
    "waypoints": (wpl.read, rows),
    "waypoints, every line repaired": (wpl.read, lambda n: rows(n).replace("\t", "  ")),
    "waypoints, comments": (wpl.read, lambda n: "QGC WPL 110\n" + "# nothing\n" * n),
    "waypoints, one line of spaces": (
        lambda text: error_of(lambda: wpl.read(text)),
        lambda n: "QGC WPL 110\n1" + " " * 40 * n + "x",
    ),
    "waypoints, jumps": (lambda text: wpl.read(text).doubts(), lambda n: rows(n).replace("\t16\t", "\t177\t")),
    "plan": (plan.read, lambda n: plan_of(",".join(item(k + 1) for k in range(n)))),
    "plan, every entry kept": (
        lambda text: plan.write(plan.read(text)),
        lambda n: plan_of(",".join(item(7) for _ in range(n))),
    ),
    "csv": (read_csv, lambda n: HEADER + "\n" + "1,16,3,0,0,0,,33.2,-98.1,60,ABOVE_HOME,1\n" * n),
    "kml": (
        read_kml_drawing,
        lambda n: f"<kml><LinearRing><coordinates>{points(n)}</coordinates></LinearRing></kml>",
    ),
    "kml, deep": (read_kml_drawing, lambda n: "<kml>" + "<a>" * n + "</a>" * n + "</kml>"),
    "kml, names": (read_kml_drawing, lambda n: f"<kml><Placemark><name>{'&lt;' * n}</name></Placemark></kml>"),
    "geojson": (read_geojson, lambda n: json.dumps({"type": "MultiPoint", "coordinates": [[1.5, 2.5]] * n})),
    "poly": (read_area_list, lambda n: "".join(f"{k / n} {k * k / n / n}\n" for k in range(n))),
    "bytes": (lambda text: text_from_bytes(text.encode("latin-1")), lambda n: "é\r\n" * n),
}


@pytest.mark.no_cover  # what is timed is not traced
@pytest.mark.parametrize("name", SIZES)
def test_no_reader_takes_quadratic_time(name: str) -> None:
    read, make = SIZES[name]

    def seconds(count: int) -> float:
        text = make(count)
        best = float("inf")
        for _ in range(3):
            start = time.process_time()
            read(text)
            best = min(best, time.process_time() - start)
        return best

    assert seconds(8_000) < 10.0 * seconds(2_000) + 0.05


@pytest.mark.long
def test_two_hundred_thousand_lines_are_read() -> None:
    assert len(wpl.read(rows(200_000)).items) == 199_999


@pytest.mark.long
@pytest.mark.parametrize("name", ["waypoints", "plan", "csv", "kml", "geojson", "poly"])
def test_fifty_megabytes_are_read_in_a_minute(name: str) -> None:
    read, make = SIZES[name]
    size = len(make(1000)) / 1000.0
    text = make(round(50e6 / size))
    start = time.process_time()
    read(text)
    assert time.process_time() - start < 60.0


def error_of(call: Callable[[], object]) -> str:
    """The message of the FormatError that a call raises; empty when it raises none."""
    try:
        call()
    except FormatError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("depth", [500, 990, 5_000, 200_000])
def test_deep_json_is_kept_or_refused(depth: int) -> None:
    deep = '{"a":' * depth + "1" + "}" * depth
    for text in (deep, "[" * depth):
        for read in (plan.read_to_keep, read_geojson):
            assert 0 < len(error_of(lambda read=read, text=text: read(text))) < 200  # type: ignore[misc]
    form = plan_of(f'{{"type": "ComplexItem", "complexItemType": "X", "deep": {deep}}}')
    error = error_of(lambda: plan.read_to_keep(form))
    assert error in ("", "plan: the JSON is nested too deeply")
    if not error:
        read_back = plan.read_to_keep(form)
        assert error_of(lambda: plan.write(read_back)) in ("", "plan: a kept entry is nested too deeply")


def test_an_xml_bomb_is_refused_before_it_grows() -> None:
    entities = "".join(f'<!ENTITY e{n + 1} "{f"&e{n};" * 10}">' for n in range(12))
    bomb = f'<!DOCTYPE kml [<!ENTITY e0 "boom">{entities}]><kml><name>&e12;</name></kml>'
    start = time.process_time()
    with pytest.raises(FormatError, match="document types are not supported"):
        read_kml_drawing(bomb)
    assert time.process_time() - start < 1.0


SLOW = frozenset({"geo_txt", "picture"})
"""PROJ looks a projection up in its data base; Pillow tries every format."""


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_mutated_files_raise_nothing_but_a_refusal(target: str) -> None:
    rng = random.Random(7)
    for data in TARGETS[target].seeds:
        TARGETS[target].read(data)
        for _ in range(150 if target not in SLOW else 10):
            TARGETS[target].attempt(mutated(data, rng))


def test_the_fuzzer_reports_what_it_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(text: str) -> None:
        raise ValueError(text[:1])

    monkeypatch.setitem(TARGETS, "poly", of_text(broken, ["1 2"]))
    finding = tmp_path / "poly.bin"
    with pytest.raises(ValueError, match=r"^.?$"):
        fuzz_by_mutations(TARGETS["poly"], 5.0, 1, finding)
    assert finding.exists()
    monkeypatch.setattr(
        "sys.argv", ["fuzz", "--child", "mutations", "--target", "poly", "--seconds", "1", "--keep", str(finding)]
    )
    assert fuzz_formats.main() == 1
    assert "ValueError" in capsys.readouterr().err
    monkeypatch.setattr(fuzz_formats, "run_child", lambda *_: (5, "Traceback"))
    monkeypatch.setattr("sys.argv", ["fuzz", "--target", "poly", "--engine", "mutations", "--keep", str(tmp_path)])
    assert fuzz_formats.main() == 1
    assert "| poly | mutations | 0 | 0 | 5 |" in capsys.readouterr().out


TEXT = wpl.write_mission(MISSION)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "latin-1"])
def test_whatever_a_program_saved_is_read(encoding: str) -> None:
    file = text_from_bytes(("# Überflug\r\n" + TEXT).encode(encoding))
    assert wpl.read(file.text).mission() == MISSION
    assert file.text.startswith("# Überflug\n")
    wanted = {"utf-8-sig": "removed a byte order mark", "utf-16": "decoded from UTF-16", "utf-32": "decoded from UTF-32",
              "latin-1": "line 1: not UTF-8; the file was read as Latin-1", "utf-8": "changed the line ends to LF"}  # fmt: skip
    assert wanted[encoding] in file.repairs


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"QGC WPL 110\n\0", "byte 12: the file has a zero byte"),
        (b"\xff\xfe\x00", "invalid UTF-16"),
        (b"\xff\xfe\x00\x00\xff\xff\xff\xff", "invalid UTF-32"),
        (b"\xfe\xff\xd8\x00\x00A", "invalid UTF-16"),
    ],
)
def test_what_is_no_text_is_refused(data: bytes, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        text_from_bytes(data)


def test_a_text_file_in_order_needs_no_repair() -> None:
    assert text_from_bytes(TEXT.encode()).repairs == ()
