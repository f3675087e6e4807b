"""A ground station for asyncio: every call of ``Client`` runs on a worker thread, so the event loop never blocks."""

import asyncio
import contextlib
import functools
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from threading import Event
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.mission_lists import MissionList
from mission_io.client.client import Client
from mission_io.client.connection import Progress, Stop
from mission_io.client.mission_control import ItemProgress, wait_for_mission
from mission_io.client.peers import VehicleInfo
from mission_io.client.transfer_outcome import ReadBack
from mission_io.model.items import MissionType

ResultT = TypeVar("ResultT")
ArgsP = ParamSpec("ArgsP")


def _on_worker(
    function: Callable[Concatenate[Client, ArgsP], ResultT],
) -> "Callable[Concatenate[AsyncClient, ArgsP], Coroutine[Any, Any, ResultT]]":
    """A method of ``Client`` as a coroutine of ``AsyncClient``."""

    @functools.wraps(function)
    async def called(client: "AsyncClient", /, *args: ArgsP.args, **kwargs: ArgsP.kwargs) -> ResultT:
        return await client.call(function, *args, **kwargs)

    return called


class AsyncClient:
    """The calls of a ``Client`` as coroutines, one at a time on one worker thread, in call order.

    A call that is cancelled (``task.cancel``, ``asyncio.timeout``, Ctrl-C under ``asyncio.run``) first ends on the link:
    a transfer is cancelled on the vehicle and read back, any other wait ends within a second. Only then is
    ``asyncio.CancelledError`` raised; its ``__cause__`` says what the vehicle holds after a transfer, and a ``clear`` may
    have emptied the list. Errors are those of the ``Client``.

    The heartbeat goes out while a call waits. Between calls, ``await client.poll(seconds)`` keeps it going.

    Args:
        client: Belongs to this object from here on: call it nowhere else. A ``listener`` of it is called on the worker
            thread.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="mission_io")

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the link after the calls that are under way; cancelling this changes nothing."""
        await _ended(asyncio.wrap_future(self._worker.submit(self._client.close)))
        self._worker.shutdown(wait=False)

    @property
    def vehicle(self) -> VehicleInfo:
        """The vehicle as of its latest heartbeat.

        Raises:
            MisuseError: ``wait_for_vehicle`` has not found one yet.
        """
        return self._client.vehicle

    wait_for_vehicle = _on_worker(Client.wait_for_vehicle)
    clear = _on_worker(Client.clear)
    command = _on_worker(Client.command)
    set_current = _on_worker(Client.set_current)
    start_mission = _on_worker(Client.start_mission)
    pause_mission = _on_worker(Client.pause_mission)
    resume_mission = _on_worker(Client.resume_mission)
    poll = _on_worker(Client.poll)

    async def upload_and_verify(
        self,
        content: MissionList,
        *,
        progress: Progress | None = None,
        in_flight: bool = False,
        autopilot: Autopilot | None = None,
    ) -> ReadBack:
        """As ``Client.upload_and_verify``; ``progress`` is called in the event loop."""
        report = _in_loop(progress)
        return await self._run(
            lambda stop: self._client.upload_and_verify(
                content, progress=report, stop=stop, in_flight=in_flight, autopilot=autopilot
            )
        )

    async def download_list(self, mission_type: MissionType, *, progress: Progress | None = None) -> MissionList:
        """As ``Client.download_list``; ``progress`` is called in the event loop."""
        report = _in_loop(progress)
        return await self._run(lambda stop: self._client.download_list(mission_type, progress=report, stop=stop))

    async def follow_mission(
        self,
        progress: Callable[[ItemProgress], None] | None = None,
        *,
        until: Callable[[ItemProgress], bool] | None = None,
        silent_s: float = 15.0,
    ) -> ItemProgress:
        """Follow the mission to its end and return its last progress; ``progress`` is called with each in the event loop."""
        loop = asyncio.get_running_loop()

        def report(latest: ItemProgress) -> None:
            if progress is not None:
                loop.call_soon_threadsafe(progress, latest)

        return await self.call(wait_for_mission, progress=report, until=until, silent_s=silent_s)

    async def call(
        self, function: Callable[Concatenate[Client, ArgsP], ResultT], /, *args: ArgsP.args, **kwargs: ArgsP.kwargs
    ) -> ResultT:
        """Call any other function of a ``Client`` on the worker: ``await client.call(Client.read_parameter, "RTL_ALT")``."""

        def waiting(stop: Stop) -> ResultT:
            self._client.give_up = stop
            try:
                return function(self._client, *args, **kwargs)
            finally:
                self._client.give_up = None

        return await self._run(waiting)

    async def _run(self, call: Callable[[Stop], ResultT]) -> ResultT:
        """Run a call on the worker. When this coroutine is cancelled, end the call first."""
        cancelled = Event()
        submitted = self._worker.submit(call, cancelled.is_set)
        running = asyncio.wrap_future(submitted)
        try:
            await asyncio.wait([running])
        except asyncio.CancelledError as error:
            cancelled.set()
            if submitted.cancel():  # it had not begun
                raise
            await _ended(running)
            raise error from running.exception()
        return running.result()


async def _ended(running: asyncio.Future[ResultT]) -> None:
    """Wait for a call that is ending already, through further cancellations."""
    while not running.done():
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.wait([running])


def _in_loop(progress: Progress | None) -> Progress | None:
    """A callback for the worker that hands its arguments to ``progress`` in the event loop."""
    if progress is None:
        return None
    loop = asyncio.get_running_loop()

    def report(done: int, total: int) -> None:
        loop.call_soon_threadsafe(progress, done, total)

    return report
