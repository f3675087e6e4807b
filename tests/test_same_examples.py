"""Hypothesis draws the same examples whatever modules a process has imported, and in whatever order."""

import os
import subprocess
import sys
from pathlib import Path

DRAW = """
import importlib, sys
from hypothesis.internal.conjecture import providers
local_constants = providers._get_local_constants
import tests.conftest
from hypothesis import given, settings, strategies as st
if sys.argv[1] == "as hypothesis does":
    providers._get_local_constants = local_constants

drawn = []

@given(st.integers(), st.floats(), st.text(), st.binary())
@settings(max_examples=200)
def draw(a, b, c, d):
    drawn.append(repr((a, b, c, d)))

for name in ("tests", *sys.argv[2:]):
    importlib.import_module(name)
    draw()
print("\\n".join(drawn).encode().hex())
"""
MODULES = {
    "with_numbers": "A, B = 123_456, 78.9125\n", "with_texts": "A, B = 'Pine Mountain', b'bytes'\n",
    "with_both": "A, B = 987_654.25, 'Clinch River'\n",
}  # fmt: skip
"""Modules and the constants in them."""


def drawn(how: str, folder: Path, *modules: str) -> list[str]:
    """The examples of a new process: some at once, and some after each module that it imports."""
    for name, text in MODULES.items():
        (folder / f"{name}.py").write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", DRAW, how, *modules],
        env={**os.environ, "PYTHONPATH": os.pathsep.join((str(Path(__file__).parents[1]), str(folder)))},
        cwd=folder, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    examples = bytes.fromhex(done.stdout).decode("utf-8", "surrogateescape").split("\n")
    assert len(examples) >= 200 * (1 + len(modules))
    return examples


def test_examples_do_not_depend_on_imports(tmp_path: Path) -> None:
    one, other = drawn("as tests do", tmp_path, *MODULES), drawn("as tests do", tmp_path, *reversed(MODULES))
    assert one == other
    first, *others = (one[k : k + len(one) // 4] for k in range(0, len(one), len(one) // 4))
    assert others == [first, first, first]


def test_without_our_hook_they_do(tmp_path: Path) -> None:
    """So the test above can fail."""
    examples = "\n".join(drawn("as hypothesis does", tmp_path, *MODULES))
    for constant in ("123456", "78.9125", "Pine Mountain"):
        assert constant in examples, "then tests/conftest.py needs no hook any more"
