"""Classes of mistakes in public bug reports of planners and ground stations, with made-up data and the right answer for each."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import shapely

from uavcover.errors import InputError
from uavcover.scenario.areas.area_file import AreaQuery, read_area


@dataclass(frozen=True, slots=True)
class Report:
    """A class of reports.

    Attributes:
        name: of the class.
        case: makes the data in a folder, gives it to the code concerned, and returns the answer as text.
        answer: that the text matches.
    """

    name: str
    case: Callable[[Path], str]
    answer: str


def _mended(rings: list[str]) -> str:
    found = read_area(AreaQuery(source=f"POLYGON ({', '.join(rings)})", make_valid=True))
    square = sum(shapely.Polygon(part[0], part[1:]).area for part in found.parts) * 1e6
    return f"{square:.0f} {' '.join(found.notes)}"


_OUTLINE = "(8 46, 8.01 46, 8.01 46.01, 8 46.01, 8 46)"
"""A hundred squares of 0.001 degrees."""


def hole_on_the_edge(_: Path) -> str:
    return _mended([_OUTLINE, "(8 46.002, 8.003 46.002, 8.003 46.005, 8 46.005, 8 46.002)"])


def holes_that_overlap(_: Path) -> str:
    holes = [f"(8.00{a} 46.00{a}, 8.00{b} 46.00{a}, 8.00{b} 46.00{b}, 8.00{a} 46.00{b}, 8.00{a} 46.00{a})" for a, b in ((2, 6), (4, 8))]  # fmt: skip
    return _mended([_OUTLINE, *holes])


def hole_that_takes_all(_: Path) -> str:
    try:
        return _mended([_OUTLINE, "(7.99 45.99, 8.02 45.99, 8.02 46.02, 7.99 46.02, 7.99 45.99)"])
    except InputError as error:
        return str(error)


REPORTS = (
    Report("a hole on the outline's edge is filled", hole_on_the_edge, r"^91 .* ha as written, .* ha now$"),
    Report("holes that overlap are half filled", holes_that_overlap, r"^72 .* ha as written, .* ha now$"),
    Report("a hole takes all of the area", hole_that_takes_all, "nothing is left of the area inside its holes; remove"),
)


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.name)
def test_each_class_has_the_right_answer(report, tmp_path):
    answer = report.case(tmp_path)
    assert re.search(report.answer, answer), answer
