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
