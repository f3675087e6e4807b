import dataclasses
import itertools
import logging

import pytest

from uavcover.planner.budget import FRACTIONS, StageTimes


def test_shares_are_shares():
    for field in dataclasses.fields(FRACTIONS):
        value = getattr(FRACTIONS, field.name)
        for fraction in value if isinstance(value, tuple) else (value,):
            assert 0.0 < fraction <= 1.0 or field.name == "simplified_until"
    assert sum(FRACTIONS.part_rounds) == pytest.approx(1.0)
    for stages in (FRACTIONS.goal_main_stages, FRACTIONS.goal_stages, FRACTIONS.goal_waypoint_stages):
        assert all(before < after for before, after in itertools.pairwise(stages))
        assert stages[-1] == 1.0


@pytest.mark.parametrize(("budget_s", "said"), [(20.0, "2.00 s allotted"), (None, "")])
def test_a_stage_logs_what_it_was_allotted_and_used(caplog, budget_s, said):
    moments = iter([5.0, 8.25])
    times = StageTimes(lambda: next(moments), budget_s)
    with caplog.at_level(logging.INFO), times.stage("local search", 0.1):
        pass
    (record,) = caplog.records
    assert "local search" in record.getMessage()
    assert "3.25 s used" in record.getMessage()
    assert ("allotted" in record.getMessage()) == bool(said)
    assert said in record.getMessage()


def test_a_stage_that_fails_is_logged_too(caplog):
    moments = iter([0.0, 1.0])
    times = StageTimes(lambda: next(moments), 1.0)
    with caplog.at_level(logging.INFO), pytest.raises(ValueError, match="no"), times.stage("choice"):
        raise ValueError("no")
    assert "1.00 s used" in caplog.text
