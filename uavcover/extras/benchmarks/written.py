"""What benchmarks write about their runs: CSV and Markdown tables, files and pictures."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from uavcover.run.folder import write_text


def csv_text(header: Sequence[object], rows: Iterable[Iterable[object]]) -> str:
    """A table as CSV; numbers unrounded.

    >>> print(csv_text(["a", "b"], [[1, 0.5]]), end="")
    a,b
    1,0.5
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table.

    >>> print(markdown(["a", "b"], [["1", "2"]]))
    | a | b |
    |---|---|
    | 1 | 2 |
    """
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("|" + "|".join(f" {cell} " if cell != "---" else cell for cell in line) + "|" for line in lines)


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts by the names of their files; returns the files. Raises OutputError: one cannot be written."""
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


@contextmanager
def drawn(path: Path, *, dpi: int) -> Iterator[Any]:
    """``matplotlib.pyplot`` without a window; the figure that is made inside is written to the file, and closed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    try:
        yield pyplot
        pyplot.savefig(path, dpi=dpi)
    finally:
        pyplot.close()
