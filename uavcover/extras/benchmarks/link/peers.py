"""Measurements of the link benchmark, and the clients and vehicles that transfer missions in them.

A client transfers a mission over one link and says whether it believes that it worked. The vehicles only transfer missions,
many of them in one process, each behind a UDP port that loses datagrams. Tables have one row for each cell of the grid.
"""

import contextlib
import math
import select
import socket
import statistics
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection
from random import Random
from typing import Any, Final

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import stored_item
from mission_io.client.client import Client
from mission_io.errors import MissionIoError, MisuseError
from mission_io.links.datagrams import Link, UdpLink
from mission_io.links.simulated import Conditions, SimulatedLink, fate
from mission_io.model.enums import VehicleClass
from mission_io.model.items import Frame, MissionItem, MissionType, waypoint
from mission_io.protocol.server import MissionServer
from mission_io.protocol.timing import Timing
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address, Heartbeat, degrees_on_wire
from uavcover.errors import VehicleError
from uavcover.plugins import load

AUTOPILOTS: Final[dict[str, Autopilot]] = {"ardupilot": ARDUPILOT, "px4": PX4}
"""One asks again after 1 s and gives up after 8 s, the other after 250 ms and 5 s."""

CLIENTS: Final = ("simulated", "native", "mavsdk")
"""Ours in simulated time, ours over UDP, MAVSDK's over UDP."""

DIRECTIONS: Final = ("upload", "download")
ITEMS: Final = 100


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One transfer of a list to or from a new vehicle, with that fraction of the datagrams lost each way."""

    client: str  # one of ``CLIENTS``
    vehicle: str  # one of ``AUTOPILOTS``
    direction: str  # one of ``DIRECTIONS``
    delay_s: float  # how long each datagram is under way, in seconds
    loss: float  # fraction of the datagrams lost, each way
    seed: int  # of the losses
    items: int = ITEMS  # how many there are in the list


@dataclass(frozen=True, slots=True)
class TransferOutcome:
    """Outcome of a trial."""

    trial: Trial
    claimed: bool  # whether the client says that it worked
    correct: bool  # whether the list at the receiving end is the one that was sent, independent of the client's claim
    time_s: float  # how long the client took, from being asked to its answer
    error: str = ""  # what it said when it failed

    def row(self) -> dict[str, str]:
        """As a line of a CSV file."""
        trial = {field.name: str(getattr(self.trial, field.name)) for field in fields(Trial)}
        own = {field.name: str(getattr(self, field.name)) for field in fields(TransferOutcome) if field.name != "trial"}
        return {**trial, **own}

    @classmethod
    def of_row(cls, row: dict[str, str]) -> "TransferOutcome":
        """Read a trial from a line of a CSV file.

        Raises:
            KeyError: a column is missing.
            ValueError: a number is none.
        """
        numbers = float(row["delay_s"]), float(row["loss"]), int(row["seed"]), int(row.get("items") or ITEMS)
        trial = Trial(row["client"], row["vehicle"], row["direction"], *numbers)
        return cls(
            trial,
            row["claimed"] == "True",
            row["correct"] == "True",
            float(row["time_s"]),
            row["error"],
        )


COLUMNS: Final = (*(f.name for f in fields(Trial)), *(f.name for f in fields(TransferOutcome) if f.name != "trial"))


def mission_items(count: int = ITEMS) -> tuple[MissionItem, ...]:
    """A mission in which no two items, and no latitude and longitude, are identical."""
    return tuple(
        waypoint(
            degrees_on_wire(46.1 + i * 1e-3),
            degrees_on_wire(-7.2 - i * 2e-3),
            100.0 + i,
            frame=Frame.ABOVE_HOME,
            hold_s=float(i % 7),
        )
        for i in range(count)
    )


def items_on(vehicle: str, count: int = ITEMS) -> tuple[MissionItem, ...]:
    """The same as that autopilot stores it."""
    return tuple(stored_item(item, AUTOPILOTS[vehicle]) for item in mission_items(count))


_NAMES = {"simulated": "ours, simulated", "native": "ours, UDP", "mavsdk": "MAVSDK, UDP"}


@dataclass(frozen=True, slots=True)
class Cell:
    """The trials that differ in their seed only.

    Attributes:
        runs: How many.
        correct: How many worked, and said so.
        wrong_unnoticed: How many said that they worked, and did not.
        median_s, slowest_s: Of those that worked; NaN when none did.
    """

    vehicle: str
    direction: str
    delay_s: float
    loss: float
    client: str
    runs: int
    correct: int
    wrong_unnoticed: int
    median_s: float
    slowest_s: float


def cells_of(outcomes: Iterable[TransferOutcome]) -> list[Cell]:
    """Every cell, in the order of the table."""
    groups: dict[tuple[str, str, float, float, str], list[TransferOutcome]] = {}
    for outcome in outcomes:
        trial = outcome.trial
        groups.setdefault((trial.vehicle, trial.direction, trial.delay_s, trial.loss, trial.client), []).append(outcome)
    order = [list(AUTOPILOTS), list(DIRECTIONS), None, None, list(CLIENTS)]
    keys = sorted(groups, key=lambda key: [names.index(k) if names else k for names, k in zip(order, key, strict=True)])  # type: ignore[arg-type]
    return [_cell(key, groups[key]) for key in keys]


def _cell(key: tuple[str, str, float, float, str], outcomes: Collection[TransferOutcome]) -> Cell:
    times = sorted(outcome.time_s for outcome in outcomes if outcome.claimed and outcome.correct)
    return Cell(
        *key,
        runs=len(outcomes),
        correct=len(times),
        wrong_unnoticed=sum(outcome.claimed and not outcome.correct for outcome in outcomes),
        median_s=statistics.median(times) if times else math.nan,
        slowest_s=times[-1] if times else math.nan,
    )


def markdown(cells: Collection[Cell]) -> str:
    """The cells as a table: a line for each vehicle, direction and loss, the clients side by side."""
    clients = [client for client in CLIENTS if any(cell.client == client for cell in cells)]
    by_key = {(cell.vehicle, cell.direction, cell.delay_s, cell.loss, cell.client): cell for cell in cells}
    head = ["vehicle", "transfer", "delay", "loss", *(f"{_NAMES[c]}: worked | median, slowest" for c in clients)]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * (4 + 2 * len(clients))}"]
    for vehicle, direction, delay_s, loss in dict.fromkeys((c.vehicle, c.direction, c.delay_s, c.loss) for c in cells):
        entries = [_entry(by_key.get((vehicle, direction, delay_s, loss, client))) for client in clients]
        lines.append(f"| {vehicle} | {direction} | {delay_s * 1e3:g} ms | {loss:.0%} | {' | '.join(entries)} |")
    return "\n".join(lines)


def _entry(cell: Cell | None) -> str:
    if cell is None:
        return "- | -"
    wrong = f", {cell.wrong_unnoticed} wrong unnoticed" if cell.wrong_unnoticed else ""
    times = "-" if not cell.correct else f"{_seconds(cell.median_s)}, {_seconds(cell.slowest_s)}"
    return f"{cell.correct}/{cell.runs}{wrong} | {times}"


def _seconds(time_s: float) -> str:
    return f"{time_s * 1e3:.1f} ms" if time_s < 0.1 else f"{time_s:.2f} s"


_LOCALHOST = "127.0.0.1"
_SYSTEM = Address(1, 1)


class MissionVehicle:
    """A vehicle on the ground: heartbeats and the mission protocol, as datagrams. A ``Peer`` of a simulated link."""

    def __init__(self, autopilot: Autopilot, items: tuple[MissionItem, ...], *, now: float) -> None:
        self._codec = Codec(system_id=_SYSTEM.system_id, component_id=_SYSTEM.component_id)
        self._heartbeat = Heartbeat(autopilot.mav_autopilot, VehicleClass.QUADROTOR, system_status=3)
        self._beat_at = now
        self._server = MissionServer(autopilot, local=_SYSTEM)
        self._server.set_items(MissionType.MISSION, items)

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The mission that it holds."""
        return self._server.items(MissionType.MISSION)

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram."""
        for received in self._codec.decode(data):
            self._server.receive(received, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """Datagrams to send by now."""
        messages = list(self._server.messages_to_send(now))
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            messages.append(self._heartbeat)
        return [self._codec.encode(message) for message in messages]

    def next_timer(self) -> float:
        """Time of the next datagram without an incoming one."""
        timer = self._server.next_timer()
        return self._beat_at if timer is None else min(timer, self._beat_at)


def vehicle_for(trial: Trial, *, now: float) -> MissionVehicle:
    """A trial's vehicle: empty for an upload, with the mission for a download."""
    items = items_on(trial.vehicle, trial.items) if trial.direction == "download" else ()
    return MissionVehicle(AUTOPILOTS[trial.vehicle], items, now=now)


def conditions_of(trial: Trial) -> Conditions:
    """Link conditions of a trial, each way."""
    return Conditions(loss=trial.loss, delay_s=trial.delay_s)


class _LossyPort:
    """A vehicle behind a UDP socket; what comes in and what goes out is late, and gets lost by seed."""

    def __init__(self, trial: Trial, *, now: float) -> None:
        self.vehicle = vehicle_for(trial, now=now)
        self._conditions = conditions_of(trial)
        self._rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
        self._ground: tuple[str, int] | None = None
        self._coming: deque[tuple[float, bytes]] = deque()
        self._going: deque[tuple[float, bytes]] = deque()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind((_LOCALHOST, 0))
        self.port: int = self.socket.getsockname()[1]

    def receive(self) -> None:
        """Take one datagram off the socket, if it is not lost."""
        try:
            data, self._ground = self.socket.recvfrom(65535)
        except OSError:
            return  # the ground station has gone
        self._put(data, self._coming)

    def run_until_now(self) -> None:
        """Process everything due: incoming datagrams, the vehicle's, and outgoing ones."""
        now = time.monotonic()
        while self._coming and self._coming[0][0] <= now:
            self.vehicle.receive_datagram(self._coming.popleft()[1], now)
        if self._ground is None:
            return
        for data in self.vehicle.datagrams_to_send(now):
            self._put(data, self._going)
        while self._going and self._going[0][0] <= now:
            with contextlib.suppress(OSError):  # the ground station has gone
                self.socket.sendto(self._going.popleft()[1], self._ground)

    def next_timer(self) -> float:
        """Time of the next event."""
        queues = [queue[0][0] for queue in (self._coming, self._going) if queue]
        return min([self.vehicle.next_timer(), *queues])

    def _put(self, data: bytes, queue: deque[tuple[float, bytes]]) -> None:
        due = time.monotonic() + self._conditions.delay_s if self._conditions.delay_s else 0.0
        queue.extend((due, copy) for copy in fate(data, self._conditions, self._rng))


def serve(control: Connection) -> None:
    """Serve vehicles until ``control`` says None: a Trial opens one (answer: its port), a port closes it (answer: its items)."""
    ports: dict[int, _LossyPort] = {}
    while True:
        now = time.monotonic()
        wake = min((port.next_timer() for port in ports.values()), default=now + 1.0)
        sockets = {port.socket.fileno(): port for port in ports.values()}
        ready, _, _ = select.select([control.fileno(), *sockets], [], [], max(0.0, min(wake - now, 1.0)))
        for number in ready:
            if number in sockets:
                sockets[number].receive()
                sockets[number].run_until_now()
        for port in ports.values():
            if port.next_timer() <= time.monotonic():
                port.run_until_now()
        if control.fileno() not in ready:
            continue
        request: Trial | int | None = control.recv()
        if request is None:
            return
        if isinstance(request, Trial):
            port = _LossyPort(request, now=time.monotonic())
            ports[port.port] = port
            control.send(port.port)
        else:
            port = ports.pop(request)
            port.socket.close()
            control.send(port.vehicle.items)


_CONNECT_S = 60.0


@dataclass(frozen=True, slots=True)
class Transferred:
    """A transfer as its client saw it; ``received`` is what a download gave back."""

    claimed: bool
    time_s: float
    received: tuple[MissionItem, ...] = ()
    error: str = ""


def run_simulated(trial: Trial, timing: Timing | None = None) -> TransferOutcome:
    """Our client in simulated time."""
    vehicle = vehicle_for(trial, now=0.0)
    rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
    link = SimulatedLink(vehicle, rng=rng, conditions=conditions_of(trial))
    return outcome_of(trial, _with_our_client(link, trial, timing), vehicle.items)


def run_native(trial: Trial, port: int) -> Transferred:
    """Our client over UDP."""
    return _with_our_client(UdpLink.connecting("127.0.0.1", port), trial, None)


def _with_our_client(link: Link, trial: Trial, timing: Timing | None) -> Transferred:
    with Client(link, timing=timing) as client:
        client.wait_for_vehicle(_CONNECT_S)
        items = mission_items(trial.items)
        start = client.clock.now()
        received: tuple[MissionItem, ...] = ()
        try:
            if trial.direction == "upload":
                client.upload(MissionType.MISSION, items)
            else:
                received = client.download(MissionType.MISSION)
        except MissionIoError as error:
            return Transferred(False, client.clock.now() - start, error=str(error))
        return Transferred(True, client.clock.now() - start, received)


def run_mavsdk(trial: Trial, port: int) -> Transferred:
    """MAVSDK's client over UDP."""
    from mavsdk.plugins.mission_raw import MissionRawError

    plugin = load("uavcover.clients", "mavsdk")
    with _mission_raw(port) as raw:
        items = plugin.raw_items(mission_items(trial.items), MissionType.MISSION)
        call: Callable[[], Any] = raw.download_mission
        if trial.direction == "upload":
            call = lambda: raw.upload_mission(items)  # noqa: E731
        start = time.perf_counter()
        try:
            result = call()
        except MissionRawError as error:
            return Transferred(False, time.perf_counter() - start, error=str(error).partition(";")[0])
        time_s = time.perf_counter() - start
        received = () if trial.direction == "upload" else plugin.items_from_raw(result, MissionType.MISSION)
        return Transferred(True, time_s, received)


def outcome_of(trial: Trial, transferred: Transferred, held: tuple[MissionItem, ...]) -> TransferOutcome:
    """Outcome of a transfer, from the final content of the vehicle."""
    there = held if trial.direction == "upload" else transferred.received
    return TransferOutcome(
        trial,
        transferred.claimed,
        there == items_on(trial.vehicle, trial.items),
        transferred.time_s,
        transferred.error,
    )


@contextmanager
def _mission_raw(port: int) -> Iterator[Any]:
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    mavsdk.log_subscribe(lambda *_: True)
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    try:
        ground.add_any_connection(f"udpout://127.0.0.1:{port}")
        system = ground.first_autopilot(_CONNECT_S)
        if system is None:
            raise VehicleError(f"MAVSDK found no vehicle at port {port} within {_CONNECT_S:g} s")
        raw = MissionRaw(system)
        try:
            yield raw
        finally:
            raw.destroy()
    finally:
        ground.destroy()


REAL_CLIENTS: dict[str, Callable[[Trial, int], Transferred]] = {"native": run_native, "mavsdk": run_mavsdk}
"""The clients that need a vehicle at a UDP port."""


def run_real(trial: Trial, port: int) -> Transferred:
    """Run a trial's client against the vehicle at a port.

    Raises:
        MisuseError: a client that is none of ``REAL_CLIENTS``.
    """
    try:
        run = REAL_CLIENTS[trial.client]
    except KeyError:
        raise MisuseError(f"unknown client {trial.client!r}; choose from {', '.join(REAL_CLIENTS)}") from None
    return run(trial, port)
