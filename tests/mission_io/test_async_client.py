"""AsyncClient: the calls of Client as coroutines, an event loop that goes on, and cancelling that ends on the link.

The simulated link's clock moves only while a call waits, so a wait that nobody cancels takes no time either.
"""

import asyncio
import random
import threading
from collections.abc import Callable
from typing import Any

import pytest

from mission_io import AsyncClient, Client, MissionType
from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.errors import MissionIoError, TransferCancelledError, VehicleSilentError, WaitCancelledError
from mission_io.links.simulated import SimulatedLink
from mission_io.wire.messages import Heartbeat, Message, MissionCount, MissionItemInt, MissionRequestInt, Received
from tests.mission_io.formats.samples import FENCE, MISSION
from tests.mission_io.vehicle import VehiclePeer


class Gate(VehiclePeer):
    """A vehicle that waits in the middle of what it hears until the test lets it go on."""

    def __init__(self, autopilot: Autopilot = ARDUPILOT) -> None:
        super().__init__(autopilot)
        self.kind: type[Message] | None = None
        self.left = 0
        self.reached, self.go_on = threading.Event(), threading.Event()

    def hold_at(self, kind: type[Message], nth: int) -> None:
        """Wait at the nth message of a kind from here on."""
        self.kind, self.left = kind, nth

    def on_message(self, received: Received, *_: object) -> None:
        if self.kind is not None and isinstance(received.message, self.kind):
            self.left -= 1
            if self.left == 0:
                self.reached.set()
                assert self.go_on.wait(30.0)


def client_of(peer: VehiclePeer) -> AsyncClient:
    return AsyncClient(Client(SimulatedLink(peer, rng=random.Random(1))))


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda autopilot: autopilot.name)
def test_upload_download_and_clear(autopilot: Autopilot) -> None:
    peer = VehiclePeer(autopilot)
    reported: list[tuple[int, int, str]] = []

    async def session() -> None:
        loop_thread = threading.current_thread().name

        def progress(done: int, total: int) -> None:
            assert threading.current_thread().name == loop_thread
            reported.append((done, total, "up"))

        async with client_of(peer) as client:
            vehicle = await client.wait_for_vehicle(60.0)
            assert vehicle == client.vehicle
            assert (await client.upload_and_verify(MISSION, progress=progress)).passed
            assert (await client.upload_and_verify(FENCE)).passed
            assert len((await client.download_list(MissionType.MISSION)).items) == len(MISSION.items)  # type: ignore[union-attr]
            await client.clear(MissionType.FENCE)
            assert await client.call(Client.download, MissionType.FENCE) == ()

    asyncio.run(session())
    count = len(peer.server.items(MissionType.MISSION))
    assert reported[-1] == (count, count, "up")


def test_the_loop_goes_on_while_a_call_waits() -> None:
    peer = Gate()
    peer.hold_at(MissionItemInt, 3)

    async def session() -> None:
        async with client_of(peer) as client:
            await client.wait_for_vehicle(60.0)
            upload = asyncio.create_task(client.upload_and_verify(MISSION))
            await asyncio.to_thread(peer.reached.wait, 30.0)
            assert not upload.done()  # this line runs although the call does not return
            peer.go_on.set()
            assert (await upload).passed

    asyncio.run(session())


def test_calls_take_turns() -> None:
    peer = VehiclePeer()

    async def session() -> None:
        async with client_of(peer) as client:
            await client.wait_for_vehicle(60.0)
            mission, fence = await asyncio.gather(client.upload_and_verify(MISSION), client.upload_and_verify(FENCE))
            assert (mission.mission_type, fence.mission_type) == (MissionType.MISSION, MissionType.FENCE)
            assert mission.passed
            assert fence.passed

    asyncio.run(session())


def cancelled(
    peer: Gate, kind: type[Message], nth: int, call: Callable[[AsyncClient], Any], *, times: int = 1
) -> BaseException | None:
    """Cancel a call that the vehicle holds up; what the cancelled error says of the vehicle."""
    causes: list[BaseException | None] = []

    async def session() -> None:
        async with client_of(peer) as client:
            await client.wait_for_vehicle(60.0)
            peer.hold_at(kind, nth)
            task = asyncio.ensure_future(call(client))
            await asyncio.to_thread(peer.reached.wait, 30.0)
            for _ in range(times):
                task.cancel()
                await asyncio.sleep(0)
            peer.go_on.set()
            with pytest.raises(asyncio.CancelledError) as caught:
                await task
            causes.append(caught.value.__cause__)
            # The next call finds link and vehicle in order.
            assert (await client.upload_and_verify(MISSION)).passed

    asyncio.run(session())
    return causes[0]


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("nth", range(1, 8))
def test_cancelling_an_upload_cancels_it_on_the_vehicle(nth: int, times: int) -> None:
    peer = Gate(PX4)
    cause = cancelled(peer, MissionItemInt, nth, lambda client: client.upload_and_verify(MISSION), times=times)
    assert isinstance(cause, TransferCancelledError)
    # PX4 takes a list whole or not at all, and the last items may be on their way already.
    assert cause.vehicle_holds == ("replaced" if nth > 5 and cause.held_items else "unchanged")


@pytest.mark.parametrize("nth", range(1, 8))
def test_cancelling_a_download(nth: int) -> None:
    peer = Gate()
    with Client(SimulatedLink(peer, rng=random.Random(2))) as client:
        client.wait_for_vehicle(60.0)
        assert client.upload_and_verify(MISSION).passed
    cause = cancelled(peer, MissionRequestInt, nth, lambda client: client.download_list(MissionType.MISSION))
    assert isinstance(cause, TransferCancelledError)
    assert str(cause).startswith("download of the mission: ")


@pytest.mark.parametrize("nth", range(1, 8))
def test_cancelling_while_the_upload_is_read_back_says_that_it_was_not_compared(nth: int) -> None:
    cause = cancelled(Gate(), MissionRequestInt, nth, lambda client: client.upload_and_verify(MISSION))
    assert isinstance(cause, TransferCancelledError)
    assert cause.vehicle_holds == "unknown"
    assert str(cause).startswith(
        "the mission was uploaded, but could not be read back and compared: download of the mission: "
    )


@pytest.mark.parametrize("nth", [1, 2, 5])
def test_cancelling_any_other_wait(nth: int) -> None:
    def for_ever(client: Client) -> Received:
        return client.wait_until(lambda _: False, timeout_s=1e9, what="what never comes")

    assert isinstance(cancelled(Gate(), Heartbeat, nth, lambda client: client.call(for_ever)), WaitCancelledError)


def test_a_call_that_has_not_begun_is_cancelled_at_once_and_sends_nothing() -> None:
    peer = Gate()

    async def session() -> None:
        async with client_of(peer) as client:
            await client.wait_for_vehicle(60.0)
            peer.hold_at(Heartbeat, 1)
            first = asyncio.create_task(client.poll(5.0))
            await asyncio.to_thread(peer.reached.wait, 30.0)
            second = asyncio.create_task(client.upload_and_verify(MISSION))
            await asyncio.sleep(0)
            second.cancel()
            with pytest.raises(asyncio.CancelledError):
                await second  # although the first one is not over
            assert not first.done()
            peer.go_on.set()
            await first

    asyncio.run(session())
    assert not any(isinstance(received.message, MissionCount | MissionRequestInt) for received in peer.heard)


def test_errors_are_those_of_the_client() -> None:
    peer = VehiclePeer()
    peer.silent = True

    async def session() -> None:
        async with client_of(peer) as client:
            with pytest.raises(VehicleSilentError):
                await client.wait_for_vehicle(3.0)
            with pytest.raises(MissionIoError):
                await client.download_list(MissionType.MISSION)

    asyncio.run(session())


def test_close_closes_the_link_even_when_it_is_cancelled() -> None:
    closed = threading.Event()

    class Link(SimulatedLink):
        def close(self) -> None:
            closed.set()

    async def session() -> None:
        client = AsyncClient(Client(Link(VehiclePeer(), rng=random.Random(1))))
        task = asyncio.create_task(client.close())
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait([task])
        assert closed.is_set()

    asyncio.run(session())
