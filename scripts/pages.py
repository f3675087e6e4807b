"""What scripts keep: the rows of a table, so that they go on where they were stopped, and their section of a page."""

import csv
import re
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


def put_section(page: Path, title: str, text: str) -> None:
    """Replace the section ``## title`` of a page, or add it at the end; the other sections stay as they are.

    A page that is not there begins with the section.
    """
    section = f"## {title}\n\n{text.strip()}\n"
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    parts = re.split(r"^(?=## )", before, flags=re.MULTILINE)
    ours = [n for n, part in enumerate(parts) if part.startswith(f"## {title}\n")]
    if ours:
        parts[ours[0]] = section
    else:
        parts.append(section)
    page.write_text("\n".join(part.strip() + "\n" for part in parts if part.strip()), encoding="utf-8")
