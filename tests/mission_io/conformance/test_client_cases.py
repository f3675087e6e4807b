"""Every case for ground stations passes with a client that keeps to the guide, and fails with one that has just that fault."""

import pytest

from mission_io.client.client import Client
from mission_io.conformance.case import CaseResult, Outcome
from mission_io.conformance.client_case import ClientCase, Operation
from mission_io.conformance.client_cases import CLIENT_CASES
from mission_io.conformance.run import judge_client
from mission_io.errors import MissionIoError, TransferError
from mission_io.protocol.timing import Timing
from tests.mission_io.conformance.clients import IGNORES_ERRORS, MUTANTS, begun, chattering

BY_NAME = {case.name: case for case in CLIENT_CASES}
STRICT = Timing(items_ahead=0)
NACKS = sorted(name for name in BY_NAME if name.startswith("upload-nack-"))
NO_WORD_COUNTS = {"upload-reboot", "upload-ack-lost", "upload-asked-beyond", "download-count-changes", "current"}
"""Either word is right."""


def judged(case: ClientCase, **options: object) -> CaseResult:
    result = judge_client(case, begun(case), **options)  # type: ignore[arg-type]
    assert result is not None
    return result


def test_names_are_unique() -> None:
    assert len(BY_NAME) == len(CLIENT_CASES)
    assert set(MUTANTS) <= set(BY_NAME)


@pytest.mark.parametrize("name", sorted(BY_NAME))
def test_our_client_passes(name: str) -> None:
    result = judged(BY_NAME[name], timing=STRICT)
    assert result.outcome is Outcome.PASS, result.seen


def test_our_client_as_it_is_sends_one_item_ahead_and_passes_the_others() -> None:
    results = {name: judged(BY_NAME[name]) for name in ("upload-mission", "upload-only-asked", "upload-lossy")}
    assert [result.outcome.value for result in results.values()] == ["pass", "fail", "pass"]


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_client_with_that_fault_does_not_pass(name: str) -> None:
    result = judged(BY_NAME[name], wrap=MUTANTS[name])
    assert result.outcome is Outcome.FAIL, result.seen


@pytest.mark.parametrize("name", [*NACKS[::4], "upload-error-at-end"])
def test_a_client_that_ignores_errors_does_not_pass(name: str) -> None:
    result = judged(BY_NAME[name], wrap=IGNORES_ERRORS)
    assert result.outcome is not Outcome.PASS, result.seen


@pytest.mark.parametrize("name", ["upload-no-answer", "upload-nack-INVALID", "download-silence", "clear-refused"])
def test_a_client_that_never_stops_does_not_pass(name: str) -> None:
    case = BY_NAME[name]
    result = judge_client(case, chattering(case))
    assert result is not None
    assert result.outcome is Outcome.FAIL
    assert "still sending" in result.seen


def liar(case: ClientCase) -> CaseResult | None:
    """The case with a client that tells its user the opposite of what happened."""

    def call(client: Client) -> None:
        try:
            begun(case)(client)
        except MissionIoError:
            return
        raise TransferError("a lie", vehicle_holds="unknown")

    return judge_client(case, call, timing=STRICT)


@pytest.mark.parametrize("name", sorted(set(BY_NAME) - NO_WORD_COUNTS))
def test_a_client_that_tells_the_opposite_does_not_pass(name: str) -> None:
    case = BY_NAME[name]
    if case.operation is Operation.SET_CURRENT and name != "current-no-answer":
        pytest.skip("judged by what is sent")
    result = liar(case)
    assert result is not None
    assert result.outcome is not Outcome.PASS, result.seen


def test_what_begins_something_else_is_not_judged() -> None:
    result = judge_client(BY_NAME["upload-mission"], begun(BY_NAME["download-mission"]))
    assert result is None
