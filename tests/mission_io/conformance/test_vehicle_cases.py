"""Every case for vehicles passes on one that keeps to the guide, and fails on one that has just that fault."""

import random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.conformance.__main__ import VEHICLE_CASES
from mission_io.conformance.case import CaseResult, FailedError, Outcome, RefusedError, sample
from mission_io.conformance.fake_vehicle import FakeVehicle
from mission_io.conformance.probe import Probe
from mission_io.conformance.run import ask_one, ask_vehicle, keep
from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions, Peer, SimulatedLink
from mission_io.model.enums import MissionResult
from mission_io.model.items import GeoPoint, MissionType
from mission_io.wire import messages as m
from tests.mission_io.conformance.mutants import MUTANTS
from tests.mission_io.vehicle import VehiclePeer
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle

BY_NAME = {case.name: case for case in VEHICLE_CASES}


def probe_of(peer: Peer, *, loss: float = 0.0) -> Probe:
    probe = Probe(SimulatedLink(peer, rng=random.Random(1), conditions=Conditions(loss=loss)))
    probe.client.wait_for_vehicle(60.0)
    return probe


def requested(peer: Peer) -> dict[str, CaseResult]:
    results = ask_vehicle(probe_of(peer), VEHICLE_CASES, tell=lambda _: None)
    return {result.case: result for result in results}


def failures(results: dict[str, CaseResult]) -> set[str]:
    return {name for name, result in results.items() if result.outcome is not Outcome.PASS}


def test_names_are_unique_and_every_case_has_a_mutant() -> None:
    assert len(BY_NAME) == len(VEHICLE_CASES)
    assert set(MUTANTS) == set(BY_NAME)


def test_a_vehicle_by_the_guide_passes_all() -> None:
    vehicle = FakeVehicle([])
    results = requested(vehicle)
    assert {name: results[name].seen for name in failures(results)} == {}
    assert vehicle.server.items(MissionType.FENCE) == sample(MissionType.FENCE, 4)  # put back


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_vehicle_with_that_fault_does_not_pass(name: str) -> None:
    result = ask_one(probe_of(MUTANTS[name]()), BY_NAME[name])
    assert result.outcome is Outcome.FAIL, result.seen


def mock(autopilot: Autopilot) -> InMemoryPeer:
    return InMemoryPeer(MockVehicle(autopilot, GeoPoint(47.0, -8.0, 400.0)))


STOPPED_BY = {f"upload-stopped-by-{name}" for name in ("ERROR", "UNSUPPORTED", "INVALID", "DENIED")}


def test_the_px4_mock() -> None:
    """As PX4 1.17, simulated, but for current-set: docs/results/links.md."""
    assert failures(requested(mock(PX4))) == STOPPED_BY | {"download-old-request", "upload-after-silence"}


def test_the_ardupilot_mock() -> None:
    """As ArduCopter 4.7.0-dev, simulated: docs/results/links.md."""
    assert failures(requested(mock(ARDUPILOT))) == STOPPED_BY | {
        "upload-silence-mission", "upload-silence-rally", "upload-first-item", "upload-int-requests",
        "upload-out-of-order", "upload-cancelled-mission", "upload-cancelled-fence", "upload-cancelled-rally",
        "upload-bad-item", "download-int-frames", "download-old-request", "clear-all", "current-beyond",
        "ids-agree", "ids-differ",
    }  # fmt: skip


def test_what_the_vehicle_held_is_put_back_after_a_crash_too() -> None:
    peer = VehiclePeer(PX4)
    before = {t: sample(t, 5, first=7) for t in MissionType}
    for t, items in before.items():
        peer.server.set_items(t, items)

    def stop(result: CaseResult) -> None:
        raise KeyboardInterrupt

    said: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        ask_vehicle(probe_of(peer), VEHICLE_CASES, tell=said.append, answered=stop)
    assert {t: peer.server.items(t) for t in MissionType} == before
    assert "has its previous lists again" in said[-1]


def test_an_armed_vehicle_is_left_alone() -> None:
    peer = VehiclePeer(PX4)
    peer.base_mode = 128
    with pytest.raises(MisuseError, match="armed"):
        ask_vehicle(probe_of(peer), VEHICLE_CASES, tell=lambda _: None)
    assert not peer.server.items(MissionType.MISSION)


def test_a_mission_that_cannot_be_read_is_not_overwritten() -> None:
    peer = MUTANTS["download-list-twice"]()
    probe = probe_of(peer)
    peer.server.receive = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(MisuseError, match="not overwritten"):
        ask_vehicle(probe, VEHICLE_CASES, tell=lambda _: None)


def test_a_vehicle_without_rally_points_is_asked_for_the_rest() -> None:
    peer = VehiclePeer(PX4)
    receive = peer.server.receive

    def without_rally(received: object, now: float) -> None:
        if getattr(received.message, "mission_type", 0) != MissionType.RALLY:  # type: ignore[attr-defined]
            receive(received, now)  # type: ignore[arg-type]

    peer.server.receive = without_rally  # type: ignore[method-assign]
    cases = [BY_NAME["upload-in-order-rally"], BY_NAME["upload-in-order-fence"]]
    results = ask_vehicle(probe_of(peer), cases, tell=lambda _: None)
    assert [result.outcome for result in results] == [Outcome.NOT_SUPPORTED, Outcome.PASS]


SENT_IN_A_BURST = {"upload-items-twice", "upload-foreign-items"}
"""What these send at once may overtake itself where the link reorders: then they are other questions."""


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_equal_vehicles_give_equal_results_over_another_link(autopilot: Autopilot) -> None:
    """A late ACK, or a request that crossed an item, was taken for the answer to the next question."""

    def outcomes(conditions: Conditions) -> dict[str, Outcome]:
        link = SimulatedLink(VehiclePeer(autopilot), rng=random.Random(1), conditions=conditions)
        probe = Probe(link)
        probe.client.wait_for_vehicle(60.0)
        return {result.case: result.outcome for result in ask_vehicle(probe, VEHICLE_CASES, tell=lambda _: None)}

    near, far = outcomes(Conditions()), outcomes(Conditions(delay_s=0.3))
    assert {name for name in near if near[name] is not far[name]} == set()
    reordered = outcomes(Conditions(delay_s=0.05, jitter_s=0.1))
    assert {name for name in near if near[name] is not reordered[name]} <= SENT_IN_A_BURST


def test_a_list_that_the_vehicle_does_not_have_is_not_kept_and_the_others_are_tried() -> None:
    class Without(VehiclePeer):
        lacks, result = MissionType.RALLY, MissionResult.UNSUPPORTED

        def instead(self, message: m.Message, *_: object) -> list[m.Message] | None:
            refused = isinstance(message, m.MissionRequestList) and message.mission_type == self.lacks
            return [m.MissionAck(255, 190, self.result, self.lacks)] if refused else None

    peer = Without(PX4)
    assert set(keep(probe_of(peer).client).lists) == {MissionType.MISSION, MissionType.FENCE}
    peer.result = MissionResult.DENIED
    with pytest.raises(MisuseError, match="rally points cannot be read, so nothing is overwritten"):
        keep(probe_of(peer).client)
    peer.lacks, peer.result = MissionType.MISSION, MissionResult.UNSUPPORTED
    with pytest.raises(MisuseError, match="mission cannot be read, so nothing is overwritten"):
        keep(probe_of(peer).client)


def test_a_list_that_is_refused_is_told_from_one_that_is_lost() -> None:
    full = probe_of(VehiclePeer(PX4, capacity=3))
    with pytest.raises(RefusedError, match="NO_SPACE"):
        full.hold(MissionType.MISSION, sample(MissionType.MISSION, 6))

    class Keeping(VehiclePeer):
        def on_message(self, *_: object) -> None:
            if self.server.events():
                self.server.set_items(MissionType.MISSION, sample(MissionType.MISSION, 2))

    with pytest.raises(FailedError, match="acknowledged, but still has"):
        probe_of(Keeping(PX4)).hold(MissionType.MISSION, ())
