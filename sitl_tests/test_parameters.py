"""The parameters in our data are those of the autopilots, by the sources that the simulators were built from."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from uavcover.flight.parameter_rules import ParameterTable, parameter_table


def _declared(root: Path, pattern: str, suffixes: tuple[str, ...]) -> set[str]:
    files = (path for path in root.rglob("*") if path.suffix in suffixes and path.is_file())
    return {name for path in files for name in re.findall(pattern, path.read_text(errors="replace"))}


def _unknown(table: ParameterTable, known: set[str]) -> Iterator[str]:
    for row in table.rows:
        names = [name for name, _ in row.names]
        if not row.other_version and not any(name in known for name in names):
            yield names[0]


def test_ardupilot_has_the_parameters() -> None:
    binary = os.environ.get("UAVCOVER_ARDUCOPTER")
    root = Path(binary).resolve().parents[3] if binary else Path()
    if not (root / "libraries").is_dir() or not binary:
        pytest.skip("UAVCOVER_ARDUCOPTER names no binary in its source tree")
    ends = _declared(root / "libraries", r"@Param: (\w+)", (".cpp",)) | _declared(
        root / "ArduCopter", r"@Param: (\w+)", (".cpp",)
    )
    table = parameter_table(px4=False)
    names = {name for row in table.rows for name, _ in row.names}
    known = {name for name in names if any(name[start:] in ends for start in range(len(name) - 2))}
    assert list(_unknown(table, known)) == []


def test_px4_has_the_parameters() -> None:
    build = os.environ.get("UAVCOVER_PX4")
    root = Path(build).resolve().parents[1] / "src" if build else Path()
    if not root.is_dir() or not build:
        pytest.skip("UAVCOVER_PX4 names no build folder in its source tree")
    known = _declared(root, r"PARAM_DEFINE_\w+\(\s*([A-Z0-9_]+)", (".c", ".h"))
    known |= _declared(root, r"(?m)^\s+([A-Z][A-Z0-9_]+):", (".yaml",))
    assert list(_unknown(parameter_table(px4=True), known)) == []
