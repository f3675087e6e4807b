import math
from dataclasses import replace

import pytest
from hypothesis import given, settings

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import read_csv, write_csv
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
