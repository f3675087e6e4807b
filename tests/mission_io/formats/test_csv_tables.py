"""Every text format in every dialect: the same content, or an error that names the dialect."""

import math
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given, settings

from mission_io.errors import FormatError
from mission_io.formats import csv_tables, wpl
from mission_io.formats.csv_tables import HEADER, read_csv, sniff, words_of, write_csv
from mission_io.formats.drawings import read_area_list, read_rally_list
from mission_io.formats.text import MissionFile
from mission_io.model.items import Mission
from tests.mission_io.formats.samples import MISSION, MISSIONS, NAN_YAW

TEXT = write_csv(MISSION)


@settings(derandomize=True, max_examples=150)
@given(MISSIONS)
def test_round_trip(mission: Mission) -> None:
    assert read_csv(write_csv(mission)) == MissionFile(mission)
    without_home = replace(mission, home=None)
    assert read_csv(write_csv(without_home)).mission == without_home


def test_no_value_is_an_empty_cell() -> None:
    read = read_csv(write_csv(Mission(None, (NAN_YAW,)))).mission
    assert math.isnan(read.items[0].params[3])


def test_what_a_spreadsheet_does_to_it_is_repaired_and_listed() -> None:
    rows = [line.split(",") for line in TEXT.splitlines()]
    shuffled = "\r\n".join(",".join(['"a, b"', *row[::-1]]) for row in rows).replace('"a, b"', "note", 1) + "\r\n\r\n"
    read = read_csv("\ufeff" + shuffled.replace(",8\r\n", ",18\r\n"))
    assert read.mission == MISSION
    assert read.repairs == (
        "removed a byte order mark", "changed the line ends to LF", "line 1: ignored 1 columns, the first of which is 'note'",
        "line 10: renumbered from 18 to 8",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "line 1: 0 columns are named item, but there must be one"),
        (TEXT.replace("lat_deg", "latitude"), "line 1: 0 columns are named lat_deg"),
        (TEXT.replace("ABOVE_HOME", "AGL", 1), "line 3, alt_datum: 'AGL' is not a supported datum; use AMSL, COMMAND"),
        (TEXT.replace(",AMSL,", ",ABOVE_HOME,", 1), "line 2: frame 0 is not ABOVE_HOME; use 3"),
        (TEXT.replace("\n1,22,", "\n1,99999,"), "line 3: the command must be between 0 and 65535, not 99999"),
        (TEXT.replace("\n1,22,", "\n1.5,22,"), "line 3, item: '1.5' is not a whole number"),
        (TEXT.replace("12.5", "fast"), "line 4, param2: 'fast' is not a finite number"),
        (TEXT.replace("33.21875,-98.1234567", "-98.1234567,33.21875", 1), "write latitude first"),
        (TEXT[:-2] + "7\n", "line 10, autocontinue: must be 0 or 1"),
        (TEXT + "9,16\n", "line 11: the row has 2 columns, but the header has 12"),
        (TEXT + '9,"16', "line 11: invalid"),
        (TEXT + "x" * 200_000, "line 11: invalid CSV: field larger"),
    ],
)
def test_what_cannot_be_read_is_one_error_with_its_line(text: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        read_csv(text)


ITEMS = [
    HEADER,
    "0,16,0,0.0,0.0,0.0,0.0,46.51234,8.0123,512.25,AMSL,1",
    "1,22,3,0.0,0.0,0.0,,46.51234,8.0123,30.5,ABOVE_HOME,1",
    "2,16,3,0.0,0.0,0.0,,46.51334,8.0133,40.5,ABOVE_HOME,1",
]
LITCHI = [
    "latitude,longitude,altitude(m),heading(deg),curvesize(m),altitudemode,speed(m/s)",
    "46.51234,8.0123,40.5,10.5,0,0,5.5",
    "46.51334,8.0133,40.5,20.5,0,0,5.5",
]
TABLES = {
    "items": (ITEMS, lambda text: read_csv(text).mission),
    "litchi": (LITCHI, lambda text: csv_tables.read_litchi(text).mission),
}


def written(rows, *, separator, decimal, quoted, space, reported):
    """A table as a spreadsheet would save it."""
    lines = []
    for number, row in enumerate(rows):
        cells = [cell.replace(".", decimal) if cell.replace(".", "").isdigit() else cell for cell in row.split(",")]
        if quoted == "all" or (quoted == "header" and number == 0):
            cells = [f'"{cell}"' for cell in cells]
        lines.append((separator + space).join(cells))
    return "\n".join([*([f"sep={separator}"] if reported else []), *lines]) + "\n"


DIALECTS = [
    {"separator": separator, "decimal": decimal, "quoted": quoted, "space": space, "reported": reported}
    for separator, decimal, quoted, space, reported in product(
        ",;\t|", ".,", ("no", "header", "all"), ("", " "), (False, True)
    )
    if not (separator == "," and decimal == "," and quoted != "all")
]


@pytest.mark.parametrize("table", TABLES)
def test_a_table_is_the_same_in_every_dialect(table):
    rows, read = TABLES[table]
    plain = read("\n".join(rows))
    for dialect in DIALECTS:
        text = written(rows, **dialect)
        assert repr(read(text)) == repr(plain), dialect
        assert csv_tables.is_litchi(text) is (table == "litchi")


@pytest.mark.parametrize("table", TABLES)
def test_decimal_commas_between_commas_are_named(table):
    rows, read = TABLES[table]
    text = written(rows, separator=",", decimal=",", quoted="no", space="", reported=False)
    with pytest.raises(
        FormatError,
        match=r"header has \d+ \(columns separated by commas, decimal points\); if it also has decimal commas",
    ):
        read(text)


def test_commas_and_points_in_one_table_are_named():
    rows = "\n".join([*ITEMS[:3], ITEMS[3]]).replace(",", ";").replace("46.51334", "46,51334")
    with pytest.raises(
        FormatError, match=r"commas \(line 4\) and decimal points \(line 2\), with columns separated by semicolons"
    ):
        read_csv(rows)


def test_a_missing_column_names_the_dialect():
    with pytest.raises(
        FormatError,
        match="columns are named item, but there must be one; the file was read as columns separated by semicolons",
    ):
        read_csv("number;command;frame\n1;16;3\n")


def test_unusual_dialects_are_listed_and_the_usual_one_is_not():
    assert sniff("\n".join(ITEMS)).repairs == ()
    assert sniff("a;b\n1,5;2\n").repairs == ("line 1: read as columns separated by semicolons, decimal commas",)
    assert str(sniff("sep=|\na|b\n")) == "columns separated by bars, decimal points"


POSITIONS = (("46.51234", "8.0123"), ("46.51334", "8.0123"), ("46.51334", "8.0133"))


@pytest.mark.parametrize("between", [" ", "\t", ";", "; ", ", ", "  ", " , "])
@pytest.mark.parametrize("decimal", ".,")
@pytest.mark.parametrize("quoted", ["", '"'])
def test_lines_of_numbers_are_the_same_in_every_dialect(between, decimal, quoted):
    if decimal == "," and between == " , ":
        return
    lines = [
        between.join(f"{quoted}{word.replace('.', decimal)}{quoted}" for word in position) for position in POSITIONS
    ]
    assert (
        read_area_list("\n".join(lines)).areas[0]
        == read_area_list("\n".join(" ".join(position) for position in POSITIONS)).areas[0]
    )
    item = ("0", "1", "0", "16", "0", "0", "0", "0", "46.5", "8.5", "500.5", "1")
    row = between.join(f"{quoted}{word.replace('.', decimal)}{quoted}" for word in item)
    assert wpl.read(f"QGC WPL 110\n{row}\n").home == wpl.read("QGC WPL 110\n" + "\t".join(item) + "\n").home
    point = ("RALLY", "46.5", "8.5", "40.5", "0", "0", "0")
    row = between.join(word.replace(".", decimal) for word in point)
    assert read_rally_list(row).rally == read_rally_list(" ".join(point)).rally


@pytest.mark.parametrize(("line", "count"), [("46,51234,8,0123", 2), ("0,1,0,16,0,0,0,0,46,5,8,5,500,5,1", 12)])
def test_ambiguous_decimal_commas_are_named(line, count):
    with pytest.raises(FormatError, match="if it has decimal commas"):
        words_of(line, count)
    with pytest.raises(FormatError, match="decimal commas"):
        wpl.read(f"QGC WPL 110\n{line}\n") if count == 12 else read_area_list(line)
