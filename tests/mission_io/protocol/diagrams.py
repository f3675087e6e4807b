"""Draws the transition tables into a document: ``python -m tests.mission_io.protocol.diagrams FILE``."""

import sys
from enum import Enum
from pathlib import Path
from typing import Any, Final

from mission_io.protocol.download import DOWNLOAD_TABLE, DownloadState
from mission_io.protocol.exchange import CLEAR_TABLE, ClearState
from mission_io.protocol.tables import SERVER_TABLE, UPLOAD_TABLE, ServerState, Table, UploadState

TABLES: Final[dict[str, tuple[Table[Any, Any], Enum]]] = {
    "upload": (UPLOAD_TABLE, UploadState.ANNOUNCED),
    "download": (DOWNLOAD_TABLE, DownloadState.LISTING),
    "clear": (CLEAR_TABLE, ClearState.REQUESTED),
    "server": (SERVER_TABLE, ServerState.IDLE),
}
"""Every table with its initial state."""


def mermaid(table: Table[Any, Any], start: Enum) -> str:
    """The table as a Mermaid state diagram; events without effect are omitted."""
    lines = ["stateDiagram-v2", f"    [*] --> {start.name}"]
    arrows: dict[tuple[str, str], dict[str, list[str]]] = {}
    for row in table.rows:
        if row.state is not row.next_state or row.action:
            actions = arrows.setdefault((row.state.name, row.next_state.name), {})
            actions.setdefault(row.action, []).append(row.event.name)
    for (state, next_state), actions in arrows.items():
        labels = [",".join(events) + (f"/{action}" if action else "") for action, events in actions.items()]
        lines.append(f"    {state} --> {next_state}: {' '.join(labels)}")
    ends = dict.fromkeys(row.next_state.name for row in table.rows if table.is_end(row.next_state))
    lines.extend(f"    {end} --> [*]" for end in ends)
    return "\n".join(lines)


def with_diagrams(document: str) -> str:
    """The document with each table's diagram and states between its two marks, ``<!-- NAME table: begin -->`` and ``end``."""
    for name, (table, start) in TABLES.items():
        begin, end = f"<!-- {name} table: begin -->\n", f"<!-- {name} table: end -->"
        before, rest = document.split(begin)
        _, after = rest.split(end)
        meanings = "\n".join(f"- `{state.name}`: {state.value}" for state in type(start))
        document = f"{before}{begin}```mermaid\n{mermaid(table, start)}\n```\n\n{meanings}\n{end}{after}"
    return document


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(with_diagrams(path.read_text()))
