import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_io.errors import FormatError
from mission_io.formats import wpl
from mission_io.formats.text import degrees_text, plain_decimal
from mission_io.model.items import Frame, GeoPoint, Mission, MissionItem
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, MISSIONS, NAN_YAW, RALLY

STRICT = (
    "QGC WPL 110\n"
    "0\t1\t0\t16\t0\t0\t0\t0\t33.21875000\t-98.12345670\t345.678\t1\n"
    "1\t0\t3\t22\t0\t0\t0\t0\t33.21875000\t-98.12345670\t30\t1\n"
    "2\t0\t2\t178\t1\t12.5\t-1\t0\t0\t0\t0\t1\n"
)


def test_the_strict_form_byte_for_byte() -> None:
    assert wpl.write_mission(replace(MISSION, items=MISSION.items[:2])) == STRICT


@settings(derandomize=True, max_examples=150)
@given(MISSIONS)
def test_round_trip(mission: Mission) -> None:
    text = wpl.write_mission(mission)
    back = wpl.read(text)
    assert back.mission() == mission
    assert back.repairs == ()
    assert "\r" not in text
    assert "e" not in text.split("\n", 1)[1].lower()
    assert wpl.write_mission(back.mission()) == text


def test_fences_and_rally_points_are_files_of_the_same_kind() -> None:
    assert wpl.read(wpl.write_fence(FENCE, HOME)).fence() == FENCE
    assert wpl.read(wpl.write_rally(RALLY, HOME)).rally() == RALLY
    with pytest.raises(FormatError, match="not a fence item"):
        wpl.read(wpl.write_mission(MISSION)).fence()


def test_any_heading_is_written_as_zero_and_every_other_nan_is_an_error() -> None:
    text = wpl.write_mission(Mission(HOME, (NAN_YAW,)))
    assert wpl.read(text).items[0].params[3] == 0.0
    with pytest.raises(FormatError, match="row 1, param1: nan cannot be written"):
        wpl.write_mission(Mission(HOME, (replace(NAN_YAW, command=18, params=(math.nan, 0.0, 0.0, 0.0)),)))
    with pytest.raises(FormatError, match="row 1, latitude: nan is not a valid coordinate"):
        wpl.write_mission(Mission(HOME, (replace(NAN_YAW, lat_deg=math.nan),)))
    with pytest.raises(FormatError, match="row 0: the mission has no home"):
        wpl.write_mission(Mission(None, ()))


@pytest.mark.parametrize(
    ("text", "repair"),
    [
        (STRICT.replace("\n", "\r\n"), "changed the line ends to LF"),
        (STRICT.replace("\n", "\r"), "changed the line ends to LF"),
        ("\ufeff" + STRICT, "removed a byte order mark"),
        ("# made by hand\n" + STRICT, "line 1: skipped a comment"),
        (STRICT.replace("\n1\t", "\n\n1\t"), "line 3: skipped an empty line"),
        (STRICT.replace("\t345.678\t1", "\t345.678\t1 # home"), "line 2: skipped a comment"),
        (STRICT.replace("\t", " "), "line 2: changed the separators to tabs"),
        (STRICT.replace("\t", ", "), "line 2: changed the separators to tabs"),
        (STRICT.replace("\t22\t", "\t22.000\t"), "line 3: command '22.000' was converted to a whole number"),
        (STRICT.replace("1\t0\t3\t22", "1\t0\t6\t22"), "line 3: changed frame 6 to 3"),
        (STRICT.replace("\n2\t0\t2", "\n7\t0\t2"), "line 4: renumbered from 7 to 2"),
        (STRICT.replace("\n2\t0\t2", "\n 2\t0\t2"), "line 4: removed space around the row"),
        (
            STRICT.replace("0\t1\t0\t16", "0\t1\t3\t16"),
            "line 2: the height of home was read as above sea level, not ABOVE_HOME; if this row is the first waypoint, insert "
            "a row for home before it",
        ),
        (
            STRICT.replace("0\t1\t0\t16\t0", "0\t1\t0\t16\t5"),
            "line 2: the first row is home; its parameters were dropped",
        ),
    ],
)
def test_what_is_repaired_is_listed(text: str, repair: str) -> None:
    back = wpl.read(text)
    assert back.mission() == wpl.read(STRICT).mission()
    assert repair in back.repairs
    assert wpl.write_mission(back.mission()) == STRICT


def test_version_120_has_no_home_row() -> None:
    back = wpl.read(STRICT.replace("110", "120"))
    assert (back.version, back.home, len(back.items)) == (120, None, 3)
    assert wpl.read("QGC WPL 110\n") == wpl.WplFile(110, None, (), ())
    assert back.items[0].alt_m == 345.678


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "line 1: the header"),
        ("QGC WPL 100\n", "line 1: 'QGC WPL 100' is not a supported header"),
        ("hello", "'hello' is not a supported header"),
        (STRICT + "3\t0\t3\t16\n", "line 5: expected 12 columns"),
        (STRICT.replace("\t12.5\t", "\tfast\t"), "line 4, param2: 'fast' is not a finite number"),
        (STRICT.replace("\t12.5\t", "\tinf\t"), "line 4, param2"),
        (STRICT.replace("\t12.5\t", "\t1e999\t"), "line 4, param2"),
        (STRICT.replace("\t12.5\t", "\t1_0\t"), "line 4, param2"),
        (STRICT.replace("\t12.5\t", "\t" + "9" * 500 + "\t"), "line 4, param2"),
        (STRICT.replace("\t178\t", "\t178.5\t"), "line 4, command: '178.5' is not a whole number"),
        (STRICT.replace("\t178\t", "\t99999\t"), "command must be between 0 and 65535, not 99999"),
        (STRICT.replace("1\t0\t3\t22", "1\t0\t1\t22"), "line 3: unknown frame 1"),
        (STRICT.replace("33.21875000\t-98.12345670\t30", "-98.12345670\t33.21875000\t30"),
         r"line 3: latitude -98\.1235, longitude 33\.2188 is not a valid position; write latitude first"),
        (STRICT.replace("33.21875000\t-98.12345670\t30", "33.2\t-198.1\t30"), "is not a valid position$"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_error_with_its_line(text: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        wpl.read(text)


@settings(derandomize=True, max_examples=200)
@given(st.text(alphabet="QGC WPL110\t\n\r#,.-e0123456789\ufeff", max_size=200))
def test_nothing_but_a_format_error_is_raised(text: str) -> None:
    for candidate in (text, STRICT + text):
        try:
            back = wpl.read(candidate)
        except FormatError:
            continue
        assert back.version in (110, 120)


def test_numbers_are_plain_and_shortest() -> None:
    assert [plain_decimal(value, "x") for value in (1e-7, -0.0, 1e22, 0.1, -2.5, 100.0)] == [
        "0.0000001", "0", "10000000000000000000000", "0.1", "-2.5", "100",
    ]  # fmt: skip
    assert degrees_text(-1e-12, "x") == "0.00000000"


def test_a_command_row_keeps_its_numbers() -> None:
    item = MissionItem(93, Frame.COMMAND, (1.5, 2.0, 3.0, 4.0), 1e6, -3.25, 7.0)
    assert wpl.read(wpl.write_mission(Mission(GeoPoint(1.0, 2.0, 3.0), (item,)))).items == (item,)


def test_jumps_of_version_120_are_counted_from_the_first_item_as_one() -> None:
    jump = "2\t0\t2\t177\t1\t3\t0\t0\t0\t0\t0\t1\n"
    rows = "0\t0\t3\t22\t0\t0\t0\t0\t33.2\t-98.1\t30\t1\n1\t0\t3\t16\t0\t0\t0\t0\t33.3\t-98.1\t30\t1\n"
    assert wpl.read("QGC WPL 120\n" + rows + jump).items[2].params[:2] == (2.0, 3.0)
    assert wpl.read("QGC WPL 110\n" + STRICT.splitlines()[1] + "\n" + jump).items[0].params[:2] == (1.0, 3.0)


def test_what_is_not_kept_to_the_bit_is_listed() -> None:
    assert wpl.losses(MISSION) == ()
    exact = replace(NAN_YAW, lat_deg=33.123456789)
    assert wpl.losses(Mission(replace(HOME, lon_deg=1e-12), (exact, NAN_YAW))) == (
        "row 1: 'any heading' is written as 0 (affected rows: 2)",
        "row 0: degrees were rounded to 8 decimals (0.6 mm) (affected rows: 2)",
    )
    assert wpl.losses(Mission(None, ())) == ()


def test_what_a_mission_planner_home_row_says_is_no_repair() -> None:
    planner = STRICT.replace("0\t1\t0\t16", "0\t1\t0\t0")
    assert wpl.read(planner).repairs == ()


def test_swapped_coordinates_are_doubted() -> None:
    swapped = STRICT.replace("33.21875000\t-98.12345670\t345", "-48.1\t33.2\t345").replace(
        "33.21875000\t-98.12345670", "33.2\t-48.1"
    )
    (doubt,) = wpl.read(swapped).doubts()
    assert (
        doubt
        == "item 1: 12075 km from home (the farthest of 1 beyond 100 km); latitude and longitude seem to be swapped"
    )
    assert wpl.read(STRICT).doubts() == ()


def test_nan_in_a_parameter_without_a_use_is_written_as_zero_and_listed() -> None:
    """QGroundControl's landing patterns have such NaN: found by the example that converts one."""
    stop = MissionItem(2001, Frame.COMMAND, (0.0, math.nan, math.nan, math.nan))
    mission = Mission(HOME, (stop,))
    assert wpl.read(wpl.write_mission(mission)).items[0].params == (0.0, 0.0, 0.0, 0.0)
    assert wpl.losses(mission) == ("row 1: NaN in a parameter without a use is written as 0 (affected rows: 1)",)
    for command in (213, 31010):
        with pytest.raises(FormatError, match="row 1, param2: nan cannot be written"):
            wpl.write_mission(Mission(HOME, (replace(stop, command=command),)))


@pytest.mark.parametrize("nan", ["nan", "Nan", "NaN", "-nan", "1.#QNAN0", "-1.#IND00"])
def test_nan_in_a_parameter_is_read_as_programs_write_it(nan: str) -> None:
    read = wpl.read(STRICT.replace("\t30\t", "\t30\t").replace("22\t0\t0\t0\t0\t", f"22\t0\t0\t0\t{nan}\t"))
    assert math.isnan(read.items[0].params[3])
    assert read.repairs == (f"line 3: param4 {nan!r} is not a number; the vehicle chooses it",)
    assert wpl.read(wpl.write_mission(read.mission())).items[0].params == (0.0, 0.0, 0.0, 0.0)


def test_nan_is_nothing_as_the_place_of_a_command_without_one_and_an_error_as_any_other() -> None:
    read = wpl.read(STRICT.replace("12.5\t-1\t0\t0\t0\t0", "12.5\t-1\t0\tnan\tnan\tnan"))
    assert (read.items[1].lat_deg, read.items[1].lon_deg, read.items[1].alt_m) == (0.0, 0.0, 0.0)
    for column, name in (("33.21875000\t-98.12345670\t30", "latitude"), ("30", "altitude")):
        with pytest.raises(FormatError, match=f"line 3, {name}: 'nan' is not a finite number"):
            wpl.read(
                STRICT.replace(
                    f"\t{column}\t", f"\tnan\t{chr(9).join(column.split(chr(9))[1:])}\t".replace("\t\t", "\t"), 1
                )
            )
    for text in ("inf", "1.#INF", "nano", "nan(0)"):
        with pytest.raises(FormatError, match="is not a finite number"):
            wpl.read(STRICT.replace("\t12.5\t", f"\t{text}\t"))


@pytest.mark.parametrize(
    "text",
    [
        STRICT.replace("QGC WPL 110", "QGC\tWPL\t110"),
        STRICT.replace("QGC WPL 110", "qgc wpl 110"),
        STRICT.replace("QGC WPL 110", "  QGC  WPL  110  "),
        "# made by hand\n\n" + STRICT,
        STRICT.replace("\t", "\u00a0\t "),
        STRICT.replace("\n", " \t\r\n"),
        "\ufeff" + STRICT.replace("\t", "   "),
    ],
)
def test_odd_first_lines_and_odd_space(text: str) -> None:
    assert wpl.read(text).mission() == wpl.read(STRICT).mission()


@pytest.mark.parametrize("command", [22, 82, 178, 206, 189])
@pytest.mark.parametrize("frame", [0, 2, 3, 10])
def test_a_first_row_that_is_an_item_is_kept(command, frame):
    """Programs that know no home row begin with a take-off in row 0: it is no home of 50 m."""
    position = "0\t0" if frame == 2 else "46.5\t8.5"
    rows = [f"0\t0\t{frame}\t{command}\t0\t0\t0\t0\t{position}\t50\t1", "1\t0\t3\t16\t0\t0\t0\t0\t46.6\t8.5\t60\t1",
            "2\t0\t2\t177\t1\t2\t0\t0\t0\t0\t0\t1"]  # fmt: skip
    read = wpl.read("QGC WPL 110\n" + "\n".join(rows) + "\n")
    assert read.home is None
    assert [item.command for item in read.items] == [command, 16, 177]
    assert read.items[0].alt_m == 50.0
    # The jump went to row 1, which is item 2 now.
    assert read.items[2].params[0] == 2.0
    assert f"the first row is command {command}, not home; it is now item 1, and home is missing" in read.repairs
