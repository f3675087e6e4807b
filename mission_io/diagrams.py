"""Puts the upload's transition table into a document as a diagram: ``python -m mission_io.diagrams FILE``."""

import sys
from pathlib import Path

from mission_io.errors import FormatError
from mission_io.protocol.table import mermaid
from mission_io.protocol.upload_table import UPLOAD_TABLE, UploadState

_BEGIN, _END = "<!-- upload table: begin -->\n", "<!-- upload table: end -->"


def with_diagram(document: str) -> str:
    """The document with the diagram between its two marks.

    Raises:
        FormatError: the marks are missing.
    """
    before, begin, rest = document.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not (begin and end):
        raise FormatError(f"no {_BEGIN.strip()} and {_END} in it", where="document")
    return f"{before}{begin}```mermaid\n{mermaid(UPLOAD_TABLE, UploadState.ANNOUNCED)}\n```\n{end}{after}"


def main(arguments: list[str]) -> int:
    """Renew the diagram in each file; the exit code."""
    for name in arguments:
        path = Path(name)
        try:
            path.write_text(with_diagram(path.read_text()))
        except FormatError as error:
            sys.stderr.write(f"{name}: {error}\n")
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
