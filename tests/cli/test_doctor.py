from importlib import metadata

import pytest

from tests.cli.conftest import Cli


def test_healthy(cli: Cli) -> None:
    ended = cli("doctor", "--json")
    assert ended.code == 0
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
    ended = cli("doctor", "--no-imports", "--json")
    assert ended.code == 0, "neither is needed"
    found = {finding["name"]: finding for finding in ended.document["findings"]}
    assert found["pyulog"] == {
        "name": "pyulog", "ok": False, "needed": False, "text": "required for PX4 logs (.ulg): pip install pyulog (extra ulog)",
    }  # fmt: skip
    assert (found["pyserial"]["ok"], found["pyserial"]["text"]) == (True, "3.5, for serial links")
