"""Kinds of options for the scripts' parsers: an impossible value is one line with exit code 2, before anything begins.

Also what scripts keep: the rows of a table, so that they resume where they stopped, and their section of a page.
"""

import argparse
import csv
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path


def existing_folder(text: str) -> Path:
    """A folder that is there."""
    if not Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text}: no such folder; name one that is there")
    return Path(text)


def existing_file(text: str) -> Path:
    """A file that is there."""
    if not Path(text).is_file():
        raise argparse.ArgumentTypeError(f"{text}: no such file; name one that is there")
    return Path(text)


def file_to_write(text: str) -> Path:
    """A file in a folder that is there, so that hours of work do not end with nowhere to write to."""
    if Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text}: is a folder; name a file")
    if not Path(text).parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: its folder is not there; create it first")
    return Path(text)


def scenario_name(text: str) -> str:
    """A bundled scenario, or the file of one."""
    from uavcover.errors import UavcoverError
    from uavcover.scenario.scenario_file import load_scenario

    try:
        load_scenario(text)
    except UavcoverError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def whole_numbers(text: str) -> list[int]:
    """Whole numbers with commas between them."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: give whole numbers, with commas between them") from None


def one_of(known: Collection[str]) -> Callable[[str], str]:
    """One of the known names."""

    def name(text: str) -> str:
        if text not in known:
            raise argparse.ArgumentTypeError(f"{text}: not known; choose from {', '.join(known)}")
        return text

    return name


def names_of(known: Collection[str]) -> Callable[[str], list[str]]:
    """Some of the known names, with commas between them."""
    return lambda text: [one_of(known)(part) for part in text.split(",")]


def first_and_second(first: Collection[str], second: Collection[str]) -> Callable[[str], tuple[str, str]]:
    """FIRST, FIRST:SECOND or :SECOND of the known names; what is left out is empty."""

    def pair(text: str) -> tuple[str, str]:
        one, _, other = text.partition(":")
        return one and one_of(first)(one), other and one_of(second)(other)

    return pair


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
