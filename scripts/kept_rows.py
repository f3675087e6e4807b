"""Rows of a table that a script keeps beside its page, so that it goes on where it was stopped."""

import csv
from collections.abc import Sequence
from pathlib import Path

Row = dict[str, str]


def read_rows(file: Path) -> list[Row]:
    """The rows of a .csv; none where there is no file."""
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def write_rows(file: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Write them all."""
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.DictWriter(out, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
