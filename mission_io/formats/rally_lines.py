"""Rally points as MAVProxy wrote them before it used ``.waypoints`` files: one point a line.

``RALLY latitude longitude altitude break_altitude landing_direction flags``, with the altitude in metres above home.
"""

from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.dialects import words_of
from mission_io.formats.text import clean_text, finite_number, place_problem
from mission_io.model.areas import FramedPoint, RallyPoints
from mission_io.model.items import Frame

_WORD = "RALLY"
_COLUMNS = 7


@dataclass(frozen=True, slots=True)
class RallyFile:
    """The content of such a file, and what was dropped or repaired to read it, one line each."""

    rally: RallyPoints
    repairs: tuple[str, ...]


def read_rally(text: str) -> RallyFile:
    """Read rally points. Fields without a present equivalent are dropped, and listed where they are set.

    Raises:
        FormatError: with the line.
    """
    clean = clean_text(text)
    repairs = list(clean.repairs)
    points: list[FramedPoint] = []
    for line_number, line in enumerate(clean.text.split("\n"), start=1):
        content = line.split("#", 1)[0].strip()
        if not content:
            continue
        where = f"line {line_number}"
        try:
            found = words_of(content, _COLUMNS)
        except FormatError as error:
            what = f"{len(content.split())} columns beginning with {content.split()[0][:20]!r}"
            advice = error.advice or f"a rally point is {_WORD} and {_COLUMNS - 1} numbers"
            raise FormatError(what, where=where, advice=advice) from None
        columns = found.words
        if columns[0] != _WORD:
            what = f"{_COLUMNS} columns beginning with {columns[0][:20]!r}"
            raise FormatError(what, where=where, advice=f"a rally point is {_WORD} and {_COLUMNS - 1} numbers")
        if found.changed:
            repairs.append(f"{where}: {found.changed}")
        lat_deg, lon_deg, alt_m, *dropped = (finite_number(column, where) for column in columns[1:])
        problem = place_problem(lat_deg, lon_deg)
        if problem is not None:
            raise FormatError(problem.what, where=where, advice=problem.advice)
        if any(dropped):
            repairs.append(f"{where}: break altitude, landing direction and flags are not kept")
        points.append(FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME))
    return RallyFile(RallyPoints(tuple(points)), tuple(repairs))
