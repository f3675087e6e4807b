"""Rally points as MAVProxy wrote them before it used ``.waypoints`` files: one point a line.

``RALLY latitude longitude altitude break_altitude landing_direction flags``, with the altitude in metres above home.
"""

from dataclasses import dataclass

from mission_io.errors import FormatError
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
    """Read rally points. What rally points of today do not have is dropped and listed where it says anything.

    Raises:
        FormatError: with the line.
    """
    clean = clean_text(text)
    repairs = list(clean.repairs)
    points: list[FramedPoint] = []
    for line_number, line in enumerate(clean.text.split("\n"), start=1):
        columns = line.split("#", 1)[0].split()
        if not columns:
            continue
        where = f"line {line_number}"
        if columns[0] != _WORD or len(columns) != _COLUMNS:
            what = f"{len(columns)} columns beginning with {columns[0][:20]!r}"
            raise FormatError(what, where=where, advice=f"a rally point is {_WORD} and {_COLUMNS - 1} numbers")
        lat_deg, lon_deg, alt_m, *dropped = (finite_number(column, where) for column in columns[1:])
        problem = place_problem(lat_deg, lon_deg)
        if problem is not None:
            raise FormatError(problem.what, where=where, advice=problem.advice)
        if any(dropped):
            repairs.append(f"{where}: break altitude, landing direction and flags are not kept")
        points.append(FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME))
    return RallyFile(RallyPoints(tuple(points)), tuple(repairs))
