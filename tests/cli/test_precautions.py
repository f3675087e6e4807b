"""What ``fly --apply-limits`` and ``--on-breach`` make of their options, and of the file with the old parameters."""

import io
import json

import pytest

from uavcover.cli import options
from uavcover.cli.console import Console
from uavcover.cli.fly import OLD_LIMITS, precautions_for
from uavcover.errors import InputError
from uavcover.flight.orders import OnBreach
from uavcover.run.folder import RunFolder


def precautions(path, *, agreed: bool = False):
    return precautions_for(RunFolder(path), Console(), on_breach=None, apply_limits=True, agreed=agreed)


def test_old_parameters_are_on_disk_while_they_are_changed(tmp_path):
    mine = precautions(tmp_path)
    assert mine.left_changed == {}
    mine.keep({"RTL_ALT": 1500.0, "FENCE_ENABLE": 0.0})
    assert precautions(tmp_path).left_changed == {"RTL_ALT": 1500.0, "FENCE_ENABLE": 0.0}  # as after a kill
    mine.keep({})
    assert not (tmp_path / OLD_LIMITS).exists()
    mine.keep({})
    assert precautions(tmp_path).left_changed == {}


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"A": "x"}', '{"A": null}', '{"A": NaN}', '{"": 1.0}', "\x00"])
def test_a_file_that_cannot_be_read_is_an_error_that_says_what_to_do(tmp_path, text):
    (tmp_path / OLD_LIMITS).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"limits_before.json: .*restore them manually, then delete the file"):
        precautions(tmp_path)


@pytest.mark.parametrize(
    ("answer", "agrees"), [("y\n", True), ("YES\n", True), ("\n", False), ("n\n", False), ("", False)]
)
def test_it_asks_on_a_terminal(tmp_path, monkeypatch, capsys, answer, agrees):
    stdin = io.StringIO(answer)
    stdin.isatty = lambda: True
    monkeypatch.setattr("sys.stdin", stdin)
    assert precautions(tmp_path).agree("RTL_ALT 1500 -> 6000") is agrees
    shown = capsys.readouterr()
    assert "RTL_ALT 1500 -> 6000" in shown.out
    assert "[y/N]" in shown.err


def test_without_a_terminal_it_needs_yes(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    assert precautions(tmp_path).agree("RTL_ALT 1500 -> 6000") is False
    assert "add --yes" in capsys.readouterr().err
    assert precautions(tmp_path, agreed=True).agree("RTL_ALT 1500 -> 6000") is True


def test_on_breach_knows_four_words():
    assert [options.on_breach(word) for word in ("tell", "hold", "return", "land")] == list(OnBreach)
    assert options.on_breach(None) is None
    with pytest.raises(InputError, match="--on-breach: must be tell, hold, return or land, not 'fly'"):
        options.on_breach("fly")


def test_the_file_is_plain_json(tmp_path):
    precautions(tmp_path).keep({"RTL_ALT": 0.1})
    assert json.loads((tmp_path / OLD_LIMITS).read_text(encoding="utf-8")) == {"RTL_ALT": 0.1}
