"""Without a terminal a long command says every minute how far it is."""

import pytest

from uavcover.cli.console import Bar, Console


def test_a_line_every_minute_with_the_time_that_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = [0.0]
    bar = Bar(None, None, Console(), what="runs", total=40, clock=lambda: now_s[0])
    for done in range(1, 21):
        now_s[0] += 30.0
        bar.update(done, note=f"last {done}")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 10
    assert lines[0] == "  runs: 5% done, about 19 min left; last 2"
    assert lines[-1] == "  runs: 50% done, about 10 min left; last 20"


def test_what_is_over_in_a_minute_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = [0.0]
    bar = Bar(None, None, Console(), what="planning", clock=lambda: now_s[0])
    for _ in range(59):
        now_s[0] += 1.0
        bar.update(1.0)
    assert capsys.readouterr().out == ""
