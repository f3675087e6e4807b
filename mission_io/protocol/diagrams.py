"""Writes the transition tables into a document as diagrams: ``python -m mission_io.protocol.diagrams FILE``."""

import sys
from enum import Enum
from pathlib import Path
from typing import Any, Final

from mission_io.errors import FormatError
from mission_io.protocol.download import DOWNLOAD_TABLE, DownloadState
from mission_io.protocol.exchange import CLEAR_TABLE, ClearState
from mission_io.protocol.tables import SERVER_TABLE, UPLOAD_TABLE, ServerState, Table, UploadState, mermaid

TABLES: Final[dict[str, tuple[Table[Any, Any], Enum]]] = {
    "upload": (UPLOAD_TABLE, UploadState.ANNOUNCED),
    "download": (DOWNLOAD_TABLE, DownloadState.LISTING),
    "clear": (CLEAR_TABLE, ClearState.ASKED),
    "server": (SERVER_TABLE, ServerState.IDLE),
}
"""Every table with its initial state."""


def drawing(name: str) -> str:
    """A table as Markdown: diagram and meaning of the states."""
    table, start = TABLES[name]
    meanings = "\n".join(f"- `{state.name}`: {state.value}" for state in type(start))
    return f"```mermaid\n{mermaid(table, start)}\n```\n\n{meanings}\n"


def with_diagrams(document: str) -> str:
    """The document with each table's drawing between its two marks, ``<!-- NAME table: begin -->`` and ``end``.

    Raises:
        FormatError: the marks are missing, or only one of two is there.
    """
    found = False
    for name in TABLES:
        begin, end = f"<!-- {name} table: begin -->\n", f"<!-- {name} table: end -->"
        before, has_begin, rest = document.partition(begin)
        _, has_end, after = rest.partition(end)
        if bool(has_begin) != bool(has_end):
            raise FormatError(f"{begin.strip()} without {end}", where="document")
        if has_begin:
            document, found = f"{before}{begin}{drawing(name)}{end}{after}", True
    if not found:
        raise FormatError(f"no marks such as <!-- {next(iter(TABLES))} table: begin --> in it", where="document")
    return document


def main(arguments: list[str]) -> int:
    """Update the diagrams in each file; returns the exit code."""
    for name in arguments:
        path = Path(name)
        try:
            path.write_text(with_diagrams(path.read_text()))
        except FormatError as error:
            sys.stderr.write(f"{name}: {error}\n")
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
