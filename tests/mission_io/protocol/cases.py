"""The scripts of ``cases.toml``: what each side of the mission protocol does in every situation of its transition table."""

import tomllib
from pathlib import Path

from tests.mission_io.protocol.scripts import Script

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def _scripts(name: str) -> tuple[Script, ...]:
    """Each row has the texts of a script, and perhaps a table of its other fields last."""
    rows = [(row, {}) if isinstance(row[-1], str) else (row[:-1], row[-1]) for row in _TABLES[name]]
    return tuple(Script(*texts, **others) for texts, others in rows)


_STALLS = ", ".join(f"req {i}, wait 6" for i in range(25))
_FETCHED = (", ".join(f"item {i}" for i in range(n)) or "item 0" for n in range(25))
_LATER_STALLS = ", ".join(f"count 60, wait 0.1, {fetched}, wait 6" for fetched in _FETCHED)

UPLOAD = (*_scripts("upload"), Script("a stall after each item", _STALLS, "STUCK", "...", items=60))
DOWNLOAD = (*_scripts("download"), Script("a stall after each item", _LATER_STALLS, "STUCK", "..."))
DOWNLOAD_IN_ANY_ORDER = _scripts("download_in_any_order")
CLEAR = _scripts("clear")
SERVER = _scripts("server")
