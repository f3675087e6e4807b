"""The running conversation with one vehicle: waiting with patience, passing on what it says, noticing that it is gone."""

from collections import deque
from collections.abc import Callable

from mission_io.autopilots import Autopilot
from mission_io.client import Client
from uavcover.errors import VehicleError
from uavcover.flight.events import EventKind, FlightEvent
from uavcover.flight.flight_plan import Patience
from uavcover.flight.modes import mode_from_custom
from uavcover.flight.monitor import Monitor

_POLL_S = 0.1
_WARNING_SEVERITY = 4


class Stopped(Exception):  # noqa: N818 - the user's wish is no error
    """The user asked for the end of the flight while something was waited for."""


class Conversation:
    """What the stages of a flight share.

    Args:
        client: talks to the vehicle.
        monitor: hears what the client hears.
        patience: how long to wait for what.
        on_event: is told what happens.
        stop: how often the user has asked to stop.
    """

    def __init__(
        self,
        client: Client,
        monitor: Monitor,
        *,
        patience: Patience,
        on_event: Callable[[FlightEvent], None],
        stop: Callable[[], int],
    ) -> None:
        self.client, self.monitor, self.patience = client, monitor, patience
        self.stop = stop
        self._on_event = on_event
        self._recent_complaints: deque[str] = deque(maxlen=3)
        self._position_lost = False

    @property
    def autopilot(self) -> Autopilot:
        """The vehicle's autopilot."""
        return self.client.vehicle.autopilot

    @property
    def complaints(self) -> str:
        """The vehicle's latest warnings as the end of a sentence; empty when there were none."""
        return f"; it says: {' | '.join(self._recent_complaints)}" if self._recent_complaints else ""

    @property
    def mode_name(self) -> str:
        """The vehicle's flight mode, for people."""
        number = self.client.vehicle.custom_mode
        mode = mode_from_custom(self.autopilot, number)
        return f"mode {number}" if mode is None else f"{mode.value} mode"

    def tell(self, kind: EventKind, text: str, *, waypoint: int | None = None) -> None:
        """Pass on an event."""
        self._on_event(FlightEvent(kind, text, self.monitor.time_s, waypoint))

    def pump(self) -> None:
        """Listen for a moment, and pass on what the vehicle says.

        Raises:
            VehicleError: its heartbeat is lost, or it restarted.
        """
        self.client.poll(_POLL_S)
        while self.monitor.texts:
            said = self.monitor.texts.popleft()
            if said.severity <= _WARNING_SEVERITY:
                self._recent_complaints.append(said.text)
            self.tell(EventKind.TEXT, said.text)
        age_s = self.client.heartbeat_age_s
        if age_s > self.patience.heartbeat_s:
            raise VehicleError(
                f"heartbeat lost: nothing from vehicle {self.client.vehicle.system_id} for {age_s:.1f} s; "
                f"it was in {self.mode_name}; look for it, and at the link"
            )
        if self.monitor.restarted:
            raise VehicleError(f"vehicle {self.client.vehicle.system_id} restarted: its clock began anew")
        self._watch_positions()

    def wait(
        self, done: Callable[[], bool], *, patience_s: float, what: Callable[[], str], stops_before: int | None = None
    ) -> None:
        """Listen until ``done``.

        Args:
            done: looks at the monitor.
            patience_s: longest time to wait, vehicle time where the vehicle tells it.
            what: what does not happen, for the error.
            stops_before: how many stops of the user are known already; None is not to look.

        Raises:
            VehicleError: it took too long, or the vehicle is gone.
            Stopped: the user asked once more.
        """
        timer = Timer(self, patience_s)
        while not done():
            if stops_before is not None and self.stop() > stops_before:
                raise Stopped
            if timer.over:
                raise VehicleError(f"{what()} within {patience_s:g} s{self.complaints}")
            self.pump()

    def _watch_positions(self) -> None:
        heard_at = self.monitor.position_at_s
        if heard_at is None:
            return
        silence_s = self.client.clock.now() - heard_at
        if silence_s > self.patience.heartbeat_s and not self._position_lost:
            self.tell(EventKind.WARNING, f"no position for {silence_s:.1f} s, although heartbeats come")
        self._position_lost = silence_s > self.patience.heartbeat_s


class Timer:
    """Runs in vehicle time where that is known, with the link's clock as the watchdog behind it."""

    def __init__(self, conversation: Conversation, patience_s: float) -> None:
        self._conversation, self._patience_s = conversation, patience_s
        self.restart()

    def restart(self) -> None:
        """Begin again."""
        self._vehicle_s = self._conversation.monitor.time_s
        self._link_s = self._conversation.client.clock.now()

    @property
    def over(self) -> bool:
        """Whether the time has passed."""
        link_elapsed_s = self._conversation.client.clock.now() - self._link_s
        now_s = self._conversation.monitor.time_s
        if now_s is None or self._vehicle_s is None:
            return link_elapsed_s > self._patience_s
        watchdog_s = self._patience_s * self._conversation.patience.watchdog
        return now_s - self._vehicle_s > self._patience_s or link_elapsed_s > watchdog_s
