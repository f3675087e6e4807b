"""Reading ``pareto.csv``."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from uavcover.documents import PARETO_COLUMNS
from uavcover.errors import InputError


@dataclass(frozen=True, slots=True)
class ParetoRow:
    """A member of the Pareto set as its file has it.

    Attributes:
        index: its number, for ``select RUN index:N``.
        coverage_of_coverable: share of what can be seen, 0..1.
        waypoint_count: how many waypoints.
        path_length_m: length of the open path in three dimensions.
        flight_time_s: at cruise speed.
        violation: of the hard limits, 0 when they hold.
        made_by: the algorithm or baseline that found it.
        chosen: whether it is the one in ``plan.json``.
    """

    index: int
    coverage_of_coverable: float
    waypoint_count: int
    path_length_m: float
    flight_time_s: float
    violation: float
    made_by: str
    chosen: bool


def read_pareto(path: Path) -> tuple[ParetoRow, ...]:
    """The members in the order of the file.

    Raises:
        InputError: the file cannot be read, or a row is not one of a Pareto set; says which.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file)
            missing = set(PARETO_COLUMNS) - set(rows.fieldnames or ())
            if missing:
                raise InputError(f"{path}: has no column {sorted(missing)[0]!r}; make it again with: uavcover plan")
            return tuple(_row(row, where=f"{path}, line {rows.line_num}") for row in rows)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error}); make it again with: uavcover plan") from error


def _row(row: dict[str, str], *, where: str) -> ParetoRow:
    try:
        member = ParetoRow(
            index=int(row["index"]),
            coverage_of_coverable=float(row["coverage_of_coverable"]),
            waypoint_count=int(row["waypoint_count"]),
            path_length_m=float(row["path_length_m"]),
            flight_time_s=float(row["flight_time_s"]),
            violation=float(row["violation"]),
            made_by=str(row["made_by"]),
            chosen=row["chosen"] == "1",
        )
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: is no member of a Pareto set ({error}); make it again with: uavcover plan"
        ) from error
    if not (math.isfinite(member.coverage_of_coverable) and math.isfinite(member.path_length_m)):
        raise InputError(f"{where}: a figure is not a finite number; make it again with: uavcover plan")
    return member
