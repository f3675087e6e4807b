"""How long to wait, against RFC 6298's own arithmetic and on links whose round trip is known."""

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from mission_io.model.items import MissionType
from mission_io.protocol.timing import AnswerDelay, Departures, RetryLimits, RoundTrip, Timing
from tests.mission_io.protocol.scripts import items
from tests.mission_io.vehicle import VehiclePeer, connected


def test_the_first_measurement_and_a_longer_one() -> None:
    """RFC 6298, 2.2 and 2.3 by hand: alpha 1/8, beta 1/4, K 4."""
    first = RoundTrip.first(0.8)
    assert (first.smoothed_s, first.variation_s, first.time_out_s) == (0.8, 0.4, pytest.approx(2.4))
    second = first.updated(1.6)
    assert second.variation_s == pytest.approx(0.75 * 0.4 + 0.25 * 0.8)
    assert second.smoothed_s == pytest.approx(0.875 * 0.8 + 0.125 * 1.6)


def test_shorter_measurements_count_more() -> None:
    assert RoundTrip(0.8, 0.1).updated(0.4).smoothed_s == pytest.approx(0.6)
    assert RoundTrip(0.8, 0.1).updated(0.05) == RoundTrip.first(0.05), "another link, or the vehicle repeated itself"


def test_steady_measurements_end_in_the_measurement() -> None:
    estimate = RoundTrip.first(2.0)
    for _ in range(60):
        estimate = estimate.updated(0.3)
    assert estimate.smoothed_s == pytest.approx(0.3)
    assert estimate.time_out_s == pytest.approx(0.3, rel=0.01)


def test_doubtful_answers_become_a_bound_after_a_run_of_them() -> None:
    retry_limits = RetryLimits()
    for bound_s in (0.9, 0.7):
        retry_limits = retry_limits.after(AnswerDelay(bound_s, certain=False))
        assert retry_limits.round_trip is None
    retry_limits = retry_limits.after(AnswerDelay(0.8, certain=False))
    assert retry_limits.round_trip is not None
    assert (retry_limits.round_trip.smoothed_s, retry_limits.is_bound) == (0.7, True)
    for _ in range(5):
        retry_limits = retry_limits.after(AnswerDelay(0.6, certain=False))
    assert retry_limits.round_trip == RoundTrip(0.6, 0.6 / 64.0), "a tighter bound"
    assert retry_limits.after(AnswerDelay(0.01, certain=True)).round_trip == RoundTrip.first(0.01), (
        "a measurement replaces it"
    )


def test_a_link_that_became_slow_is_noticed_after_eight_doubtful_answers() -> None:
    retry_limits = RetryLimits(RoundTrip(0.002, 0.0))
    for _ in range(7):
        retry_limits = retry_limits.after(AnswerDelay(0.6, certain=False))
    assert retry_limits.round_trip == RoundTrip(0.002, 0.0)
    retry_limits = retry_limits.after(AnswerDelay(0.6, certain=False))
    assert retry_limits.round_trip is not None
    assert retry_limits.round_trip.smoothed_s == 0.6
    assert RetryLimits(RoundTrip(0.002, 0.0), doubtful=7).after(AnswerDelay(0.002, certain=True)).doubtful == 0


def test_departures_forget_what_is_answered() -> None:
    departures = Departures()
    for number in range(5):
        departures.sent(number, float(number))
    departures.sent(3, 7.0)
    assert departures.age_s(3, 8.0) == 1.0
    assert departures.answered(3, 10.0) == AnswerDelay(7.0, certain=False)
    assert departures.answered(3, 10.0) is None
    assert departures.answered(4, 10.0) == AnswerDelay(6.0, certain=True)
    departures.forget_to(1)
    assert [departures.age_s(number, 10.0) for number in range(5)] == [None, None, 8.0, None, None]
    departures.clear()
    assert departures.age_s(2, 10.0) is None


@pytest.mark.parametrize("delay_s", [0.001, 0.05, 0.3])
def test_the_round_trip_of_a_link_is_found(delay_s: float) -> None:
    client = connected(VehiclePeer(PX4), conditions=Conditions(delay_s=delay_s))
    client.upload(MissionType.MISSION, items(30))
    assert client.retry_limits.round_trip is not None
    assert client.retry_limits.round_trip.smoothed_s == pytest.approx(2 * delay_s, rel=0.3)


@pytest.mark.parametrize("loss", [0.2, 0.4])
def test_and_of_one_that_loses_much(loss: float) -> None:
    found = []
    for seed in range(9):
        client = connected(VehiclePeer(PX4), seed=seed, conditions=Conditions(delay_s=0.05, loss=loss))
        client.upload(MissionType.MISSION, items(60))
        assert client.retry_limits.round_trip is not None
        found.append(client.retry_limits.round_trip.smoothed_s)
    assert 0.09 < sorted(found)[4] < 0.2


def test_a_slow_link_is_not_filled_with_duplicates() -> None:
    """At 600 ms there and back the first items go out a few times, and from then on once."""
    peer = VehiclePeer(PX4)
    client = connected(peer, conditions=Conditions(delay_s=0.3))
    client.upload(MissionType.MISSION, items(60))
    sent = len(peer.heard)
    client.upload(MissionType.MISSION, items(60))
    assert sent < 100
    assert len(peer.heard) - sent < 85, "61, heartbeats, and what answers the vehicle's own repetitions"


def test_what_was_learnt_serves_the_next_transfer() -> None:
    client = connected(VehiclePeer(PX4), conditions=Conditions(delay_s=0.3))
    client.download(MissionType.FENCE)
    learnt = client.retry_limits
    client.upload(MissionType.MISSION, items(3))
    assert client.retry_limits is not learnt
    assert client.retry_limits.round_trip is not None


@pytest.mark.parametrize(
    "wrong",
    [
        {"resend_s": 0.0},
        {"stall_s": float("nan")},
        {"give_up_s": float("inf")},
        {"resend_growth": 0.9},
        {"resend_longest_s": 0.05},
        {"items_ahead": -1},
    ],
)
def test_times_that_would_never_end_or_begin_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(MisuseError, match="Timing"):
        Timing(**wrong)  # type: ignore[arg-type]
