"""What the paper's Tables 3 and 4 report, and the highest PSP that was found for a set of 200 points."""

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Published:
    """A figure of the paper.

    Attributes:
        mean: over 10 runs.
        std: the standard deviation; NaN where there is none.
    """

    mean: float
    std: float


@cache
def published() -> MappingProxyType[tuple[str, str, str], Published]:
    """(metric, function, algorithm) -> figure, for IGD and PSP and the seven algorithms of the paper.

    Algorithm ``ceiling`` (PSP only) is no algorithm but the highest PSP that was found by optimizing 200 points against the
    reference set itself, with an IGD no worse than the paper's IMODBO: a search result, not a proof.
    """
    text = files("uavcover").joinpath("data", "paper_mmf.csv").read_text(encoding="utf-8")
    return MappingProxyType(
        {
            (row["metric"], row["function"], row["algorithm"]): Published(
                float(row["mean"]), float(row["std"] or "nan")
            )
            for row in csv.DictReader(text.splitlines())
        }
    )
