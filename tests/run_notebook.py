"""Runs the code of a notebook as a kernel would, without one: ``python -m tests.run_notebook FILE.ipynb``.

Each cell is executed in turn, in one namespace; the value of a cell's last expression is shown, as HTML where it knows how.
"""

import ast
import json
import os
import sys
from pathlib import Path
from typing import Any


def code_cells(notebook: Path) -> list[str]:
    """The source of each code cell."""
    document = json.loads(notebook.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == "code"]


def run(notebook: Path) -> list[str]:
    """Execute a notebook in its own folder; returns what its cells show."""
    os.chdir(notebook.parent)
    names: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for number, source in enumerate(code_cells(notebook), start=1):
        tree = ast.parse(source, filename=f"cell {number}")
        last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"cell {number}", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
            if value is not None:
                shown.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))
    return shown


if __name__ == "__main__":
    for text in run(Path(sys.argv[1]).resolve()):
        sys.stdout.write(text + "\n")
