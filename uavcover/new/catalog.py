"""Tables of products that come with the package: rows by name, near misses, and files of people's own."""

import difflib
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mission_io.data_tables import read_document
from uavcover.errors import InputError

_LONGEST_BITS = 1000
_MOST_NAMES = 8


def read_catalog(name: str) -> dict[str, dict[str, Any]]:
    """The rows of a table in ``uavcover/data``, by name."""
    return dict(read_document(f"uavcover/data/{name}"))


def read_row(name: str, *, table: str, option: str, command: str = "new") -> tuple[str, dict[str, Any], str]:
    """A row of a table in ``uavcover/data``, or of a TOML file of people's own.

    Args:
        name: what the user wrote.
        table: its file.
        option: that takes the name.
        command: whose ``list`` shows the table.

    Returns:
        Its name, its keys, and where it stands, for errors.

    Raises:
        InputError: it is not known, or the file cannot be read.
    """
    if name.lower().endswith(".toml"):
        return Path(name).stem, read_own_row(Path(name), option=option), f"{option}: {name}"
    rows = read_catalog(table)
    found = find_name(name, rows, option=option, command=command)
    return found, rows[found], f"{table}: {found}"


def read_own_row(path: Path, *, option: str) -> dict[str, Any]:
    """A row of people's own: the keys of a TOML file, or of its only table.

    Raises:
        InputError: the file cannot be read, or has several tables.
    """
    try:
        row = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{option}: {path} cannot be read ({type(error).__name__}); use a name or a TOML file"
        ) from error
    except (ValueError, RecursionError) as error:  # ValueError also of numbers with thousands of digits
        raise InputError(
            f"{option}: {path}: the file is not valid TOML: {error}; {option} list shows the known names"
        ) from error
    if _has_huge(row):
        raise InputError(
            f"{option}: {path}: the file has a number with hundreds of digits; {option} list shows the known names"
        )
    tables = [key for key, value in row.items() if isinstance(value, dict)]
    if len(tables) == 1 == len(row):
        return {"title": tables[0], **row[tables[0]]}
    if tables:
        raise InputError(f"{option}: {path} has several tables ({', '.join(tables[:_MOST_NAMES])}); keep only one")
    return {"title": path.stem, **row}


def _has_huge(value: object) -> bool:
    """Whether a whole number is too long to be shown: hexadecimal ones may have any length."""
    if isinstance(value, dict):
        return any(map(_has_huge, value.values()))
    if isinstance(value, list):
        return any(map(_has_huge, value))
    return isinstance(value, int) and value.bit_length() > _LONGEST_BITS


def find_name(wanted: str, rows: Mapping[str, Mapping[str, Any]], *, option: str, command: str = "new") -> str:
    """Find the row of a name, in any case and with any spaces and hyphens; also by title and alias.

    Args:
        wanted: what the user wrote.
        rows: the table.
        option: that takes the name.
        command: whose ``list`` shows the table.

    Raises:
        InputError: there is none; says what is near.
    """
    known = {_plain(name): name for name in rows}
    for name, row in rows.items():
        for other in (row["title"], *row.get("aliases", ())):
            known.setdefault(_plain(other), name)
    plain = _plain(wanted)
    if plain in known:
        return known[plain]
    near = [name for key, name in known.items() if plain and key.startswith(plain)]
    near += [known[key] for key in difflib.get_close_matches(plain, known, n=_MOST_NAMES, cutoff=0.6)]
    near += [name for key, name in known.items() if len(plain) >= 3 and plain in key]
    shown = list(dict.fromkeys(near))[:_MOST_NAMES]
    advice = (
        f"did you mean {' or '.join(shown)}?" if shown else "if it is your own TOML file, its name must end in .toml"
    )
    raise InputError(f"{option}: {wanted!r} is not known; {advice} (uavcover {command} {option} list shows all)")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9+.]", "", name.casefold())


def checked_row(row: Mapping[str, Any], *, where: str, required: tuple[str, ...], optional: tuple[str, ...]) -> None:
    """Check the keys of a row.

    Raises:
        InputError: one is missing or not known.
    """
    known = (*required, *optional, "title", "aliases", "source")
    unknown = [key for key in row if key not in known]
    if unknown:
        close = difflib.get_close_matches(unknown[0], known, n=1)
        advice = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
        raise InputError(f"{where}: {unknown[0]}: unknown key; {advice}")
    missing = [key for key in required if key not in row]
    if missing:
        raise InputError(f"{where}: {missing[0]}: the key is missing; required keys are {', '.join(required)}")


def number_of(row: Mapping[str, Any], key: str, *, where: str) -> float | None:
    """A positive number of a row; none when it is not there.

    Raises:
        InputError: it is not a positive number.
    """
    value = row.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
        raise InputError(
            f"{where}: {key}: {value!r} is not a number above 0 (the unit is the one in the name of the key)"
        )
    return float(value)


def pair_of(row: Mapping[str, Any], key: str, *, where: str) -> tuple[float, float]:
    """Two positive numbers of a row.

    Raises:
        InputError: it is not two positive numbers.
    """
    value = row[key]
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(
            f"{where}: {key}: {value!r} is not a list of two numbers; write the number across the photo, then along it"
        )
    first, second = (number_of({key: number}, key, where=where) for number in value)
    if first is None or second is None:
        raise InputError(f"{where}: {key}: two numbers are required; write the number across the photo, then along it")
    return first, second
