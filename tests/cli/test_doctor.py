import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import uavcover
from tests.cli.conftest import Cli


def test_healthy(cli: Cli) -> None:
    ended = cli("doctor", "--json", code=0)
    assert ended.document["healthy"] is True
    names = {finding["name"] for finding in ended.document["findings"]}
    assert {"python", "numba", "pymavlink", "scenario jacksboro", "PX4 simulator"} <= names
    assert all(finding["text"] for finding in ended.document["findings"])
    assert "scenario jacksboro" in ended.err


def test_quiet(cli: Cli) -> None:
    ended = cli("doctor", "-q", "--no-imports")
    assert (ended.code, ended.out, ended.err) == (0, "", "")


def test_what_ulog_files_and_serial_links_need(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    installed = metadata.version

    def version(name: str) -> str:
        if name == "pyulog":
            raise metadata.PackageNotFoundError(name)
        return "3.5" if name == "pyserial" else installed(name)

    monkeypatch.setattr(metadata, "version", version)
    ended = cli("doctor", "--no-imports", "--json", code=0)
    found = {finding["name"]: finding for finding in ended.document["findings"]}
    assert found["pyulog"] == {
        "name": "pyulog", "ok": False, "needed": False, "text": "required for PX4 logs (.ulg): pip install pyulog (extra ulog)",
    }  # fmt: skip
    assert (found["pyserial"]["ok"], found["pyserial"]["text"]) == (True, "3.5, for serial links")


def test_a_compiler_that_does_not_load_is_a_finding(tmp_path: Path) -> None:
    (tmp_path / "numba.py").write_text('raise ImportError("no LLVM here")\n', encoding="utf-8")
    there = os.pathsep.join([str(tmp_path), str(Path(uavcover.__file__).parents[1])])
    ended = subprocess.run(
        [sys.executable, "-m", "uavcover", "doctor", "--json"], capture_output=True, text=True, check=False,
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": there},
    )  # fmt: skip
    found = {finding["name"]: finding for finding in json.loads(ended.stdout)["findings"]}
    assert ended.returncode == 1
    assert "no LLVM here" in found["scenarios"]["text"]
    assert found["numpy"]["ok"]
    assert not found["numba"]["ok"]
