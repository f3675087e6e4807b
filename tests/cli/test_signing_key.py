"""``--signing-key``: what is wrong with a key is said before anything is sent; an unsigned vehicle is not believed."""

from pathlib import Path

import pytest

from tests.cli.conftest import Cli


@pytest.fixture
def key(tmp_path: Path) -> Path:
    file = tmp_path / "key"
    file.write_text("correct horse battery staple\n")
    file.chmod(0o600)
    return file


@pytest.mark.parametrize("arguments", [("download", "-o", "m.plan", "--type", "all", "--from"), ("clear", "--to")])
def test_a_key_that_others_may_read_is_refused(cli: Cli, key: Path, arguments: tuple[str, ...]) -> None:
    key.chmod(0o644)
    assert f"chmod 600 {key}" in cli(*arguments, "mock:", "--signing-key", key, code=2).error


def test_no_such_key(cli: Cli, tmp_path: Path) -> None:
    ended = cli("clear", "--to", "mock:", "--signing-key", tmp_path / "none", code=2)
    assert "cannot read the signing key" in ended.error


def test_a_vehicle_that_does_not_sign_is_not_believed(cli: Cli, key: Path) -> None:
    assert "unsigned" in cli("clear", "--to", "mock:", "--timeout", 2.5, "--signing-key", key, code=3).error
