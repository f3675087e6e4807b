"""The vehicle's reports so far, and its clock.

The monitor hears every message, whichever call waited for it. It joins status texts that arrive in pieces of 50 characters, and
derives vehicle time from the time stamps of the messages: a single wrong stamp is rejected, several that agree are believed.
"""

import math
from bisect import insort
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

from mission_io.client.client import Client
from mission_io.data_tables import data_table
from mission_io.links.datagrams import Link
from mission_io.links.opening import open_link
from mission_io.model.enums import MissionResult, MissionState
from mission_io.model.items import MissionType, ground_distance_m
from mission_io.protocol.timing import Timing
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, StatusText
from uavcover.flight.ground_contact import GroundContact


@dataclass(frozen=True, slots=True, kw_only=True)
class _Monitor:
    late_s: float
    step_s: float
    longest_step_s: float
    fastest_ratio: float
    agreeing_stamps: int
    agreeing_rare_stamps: int
    gap_s: float
    max_terrain_requested: int
    doubt_s: float
    positions_s: float
    apart_m: float
    returns: int


MONITOR = data_table(_Monitor, "uavcover/data/flight.toml", "monitor")


class TextAssembler:
    """Puts pieces of text together; a line of which a piece was lost is given as far as it came."""

    def __init__(self) -> None:
        self._open: StatusText | None = None
        self._next_chunk = 0

    def take(self, piece: StatusText) -> list[StatusText]:
        """The lines that are whole now, none to two: what was begun before ends when another line begins."""
        whole = []
        goes_on = self._open is not None and (piece.text_id, piece.chunk) == (self._open.text_id, self._next_chunk)
        if self._open is not None and not goes_on:
            whole.append(_tidy(self._open))
            self._open = None
        begun = "" if self._open is None else self._open.text
        line = StatusText(piece.severity, begun + piece.text, piece.text_id)
        if piece.text_id == 0 or len(piece.text) < m.TEXT_LETTERS:
            self._open = None
            return [*whole, _tidy(line)]
        self._open, self._next_chunk = line, piece.chunk + 1
        return whole


def _tidy(line: StatusText) -> StatusText:
    """Remove the tab by which PX4 marks a line that is also an event."""
    return StatusText(line.severity, line.text.strip())


class VehicleClock:
    """Judges stamps one by one.

    Attributes:
        time_s: the latest time, seconds since the vehicle was switched on; None while nothing is known.
        restarted: whether the time has gone back: the vehicle was switched off and on.
        proven: how many stamps right before the latest one were doubted, and are believed now that it agrees with them.
    """

    def __init__(self) -> None:
        self.time_s: float | None = None
        self.restarted = False
        self.proven = 0
        self._step_s = MONITOR.step_s
        self._doubted: list[tuple[float, float]] = []

    def begin(self) -> None:
        """Forget everything, as before a new flight."""
        self.time_s, self.restarted, self._step_s = None, False, MONITOR.step_s
        self.proven = 0
        self._doubted.clear()

    @property
    def doubted(self) -> int:
        """Number of consecutive stamps that wait for others that agree with them."""
        return len(self._doubted)

    def take(self, stamp_s: float, now: float) -> bool:
        """Whether a stamp that arrived at ``now`` on the link's clock is believed.

        A stamp that fits neither the time nor the doubted ones before it is omitted. After a silence, and after a restart, the
        first two are doubted: the third one that agrees proves them.
        """
        self.proven = 0
        if not (math.isfinite(stamp_s) and stamp_s >= 0.0):
            return False
        if self.time_s is not None and -MONITOR.late_s <= stamp_s - self.time_s <= self._step_s:
            self._doubted.clear()
            self.time_s = max(self.time_s, stamp_s)
            return True
        if self._doubted and not self._agrees(stamp_s, now):
            self._doubted.clear()
        self._doubted.append((stamp_s, now))
        stamps = [stamp for stamp, _ in self._doubted]
        longest_s = max((after - before for before, after in pairwise(stamps)), default=0.0)
        if (
            len(stamps) < (MONITOR.agreeing_stamps if longest_s <= MONITOR.step_s else MONITOR.agreeing_rare_stamps)
            or stamp_s <= stamps[0]
        ):
            return False
        self._step_s = min(MONITOR.longest_step_s, max(self._step_s, 1.5 * longest_s))
        self.restarted |= self.time_s is not None and stamp_s < self.time_s
        self.time_s = stamp_s
        self.proven = len(self._doubted) - 1
        self._doubted.clear()
        return True

    def _agrees(self, stamp_s: float, now: float) -> bool:
        """Whether a stamp fits the doubted ones: close to the last, or as far on for rare messages."""
        before_s, then = self._doubted[-1]
        gap_s = stamp_s - before_s
        if abs(gap_s) <= MONITOR.step_s:
            return True
        if not 0.0 < gap_s <= MONITOR.fastest_ratio * (now - then):
            return False
        return len(self._doubted) < 2 or 0.5 <= gap_s / max(before_s - self._doubted[-2][0], 1e-3) <= 2.0


class TwoPositions:
    """Finds positions that go back and forth between two places, as those of two vehicles with one system ID do.

    They are ordered by vehicle time: what a link loses, repeats or reorders is no jump. Sequence numbers cannot tell: one vehicle
    behind two links counts twice.

    Attributes:
        apart_m: distance between the two places; None while the positions are those of one vehicle.
    """

    def __init__(self) -> None:
        self.apart_m: float | None = None
        self._recent: list[m.GlobalPositionInt] = []

    def take(self, here: m.GlobalPositionInt) -> None:
        """Take a position."""
        recent = self._recent
        insort(recent, here, key=lambda position: position.time_boot_s)
        while recent[-1].time_boot_s - recent[0].time_boot_s > MONITOR.positions_s:
            recent.pop(0)
        if self.apart_m is None and here is recent[-1] and not _jumped_m(*recent[-2:]):
            return
        jumps = [pair for pair in pairwise(recent) if _jumped_m(*pair)]
        returns = [
            before
            for before, after in pairwise(jumps)
            if 2.0 * ground_distance_m(before[0].lat_deg, before[0].lon_deg, after[1].lat_deg, after[1].lon_deg)
            < _jumped_m(*before)
        ]
        self.apart_m = _jumped_m(*returns[-1]) if len(returns) >= MONITOR.returns else None


def _jumped_m(before: m.GlobalPositionInt, here: m.GlobalPositionInt | None = None) -> float:
    """Distance between two positions; 0 for what their speeds explain."""
    if here is None:
        return 0.0
    moved_m = ground_distance_m(before.lat_deg, before.lon_deg, here.lat_deg, here.lon_deg)
    speed_m_s = max(math.hypot(p.velocity_north_m_s, p.velocity_east_m_s) for p in (before, here))
    return moved_m if moved_m > MONITOR.apart_m + 1.5 * speed_m_s * (here.time_boot_s - before.time_boot_s) else 0.0


MessageT = TypeVar("MessageT", bound=m.Message)


class Monitor:
    """Listens to everything that arrives, also while a command or a transfer is going on.

    It is given to the client when that is made: ``Client(link, listener=monitor)``, or see :func:`open_vehicle`.

    Attributes:
        on_position: called with each position of the vehicle.
        texts: lines for the pilot that no caller has taken yet.
        events: PX4's events that nothing has taken yet.
        other_texts: lines of other components of its system, each with the component's number.
        ground: what tells whether it stands on the ground.
        positions: whether its positions are those of two vehicles.
        uids: hardware numbers in its answers, the older and the newer field of each; 0 is none.
        position_at_s: when the latest position arrived, on the link's clock.
        heard_at_s: when anything of the vehicle arrived last, on the link's clock; infinitely long ago before the first.
        gap_ended_at_s: when the vehicle was heard again after the last gap, on the link's clock; see ``has_gap``.
        gap_s: how long that gap was.
        beats: the latest heartbeats, each with its time of arrival on the link's clock.
        mode_changes: how often its flight mode changed.
        mode_changed_here: where it was when that was last heard.
        time_answers: its latest answers to questions for its time, each with its time of arrival on the link's clock.
        counts: how many messages of each kind arrived.
        reached: the highest mission item that the vehicle said it reached.
        uploads_taken: number of uploads that it acknowledged, ours or another ground station's.
        lists_taken: the same for fences and rally points, by MAV_MISSION_TYPE.
        parameters: the latest PARAM_VALUE of each parameter.
        photos_taken: the number of photos by the autopilot's own count, of which no message can be lost; None while it reported
            none, taken or failed.
        terrain_requested: the different requests for terrain heights; one more shows that an answer to an earlier one arrived.
    """

    def __init__(self) -> None:
        self.on_position: Callable[[m.GlobalPositionInt], None] | None = None
        self.texts: deque[m.StatusText] = deque(maxlen=1000)
        self.events: deque[m.Event] = deque(maxlen=100)
        self.other_texts: deque[tuple[int, m.StatusText]] = deque(maxlen=100)
        self.ground = GroundContact()
        self.positions = TwoPositions()
        self.uids: set[tuple[int, int]] = set()
        self.position_at_s: float | None = None
        self.heard_at_s = self.gap_ended_at_s = -math.inf
        self.gap_s = 0.0
        self.mode_changes = 0
        self.mode_changed_here: m.GlobalPositionInt | None = None
        self.beats: deque[tuple[float, m.Heartbeat]] = deque(maxlen=3)
        self.time_answers: deque[tuple[float, m.TimeSync]] = deque(maxlen=20)
        self.counts: Counter[type[m.Message]] = Counter()
        self.reached = -1
        self.uploads_taken = 0
        self.lists_taken: Counter[int] = Counter()
        self.parameters: dict[str, m.ParamValue] = {}
        self.photos_taken: int | None = None
        self._failed_photos: set[int] = set()
        self.terrain_requested: set[m.TerrainRequest] = set()
        self._assembler = TextAssembler()
        self._other_assemblers: dict[int, TextAssembler] = {}
        self._time = VehicleClock()
        self._doubted_since_s: float | None = None
        self._doubted: list[m.Message] = []
        self._vehicle: Address | None = None
        self._latest: dict[type, m.Message] = {}
        self._arrived_at_s: dict[type, float] = {}

    def listen_to(self, vehicle: Address) -> None:
        """Look only at this autopilot from here on, and forget what was heard of another one.

        Other components of its system (a companion computer, a gimbal) do not speak for the vehicle.
        """
        if self._vehicle != vehicle:
            self._latest.clear()
            self.ground.forget()
            self.positions, self.uids = TwoPositions(), set()
            self._time.begin()
            self._doubted.clear()
            self.photos_taken = None
            self._failed_photos.clear()
        self._vehicle = vehicle

    @property
    def time_s(self) -> float | None:
        """The vehicle's latest time, seconds since it was switched on; None while it is not known."""
        return self._time.time_s

    @property
    def restarted(self) -> bool:
        """Whether the vehicle's time went back: it was switched off and on."""
        return self._time.restarted

    def begin(self) -> None:
        """Begin a flight: what was said of an older one, and the vehicle's time then, count no more."""
        self._time.begin()
        self._doubted.clear()
        self.reached = -1
        self.forget(m.MissionCurrent)

    def latest(self, kind: type[MessageT]) -> MessageT | None:
        """The latest message of a kind."""
        message = self._latest.get(kind)
        return message if isinstance(message, kind) else None

    def forget(self, kind: type[m.Message]) -> None:
        """Wait for a fresh message of a kind: the latest one speaks of something that is over."""
        self._latest.pop(kind, None)

    def arrived_at_s(self, kind: type[m.Message]) -> float:
        """When the latest message of a kind arrived, on the link's clock; infinitely long ago before the first."""
        return self._arrived_at_s.get(kind, -math.inf)

    @property
    def doubts_positions(self) -> bool:
        """Whether positions arrive whose times contradict each other, as those of two vehicles with one system ID."""
        return self._doubted_since_s is not None

    def has_gap(self, now: float) -> bool:
        """Whether the silence at ``now`` on the link's clock is a gap, after which the vehicle's state is unknown."""
        return now - self.heard_at_s > MONITOR.gap_s

    def silence_s(self, now: float) -> float:
        """Time since the vehicle's last message, at ``now`` on the link's clock."""
        return now - self.heard_at_s

    @property
    def current_seq(self) -> int:
        """The mission item that is being flown to; -1 while it is not known."""
        current = self.latest(m.MissionCurrent)
        return -1 if current is None else current.seq

    @property
    def mission_complete(self) -> bool:
        """Whether the vehicle reports that its mission is complete."""
        current = self.latest(m.MissionCurrent)
        return current is not None and current.state == MissionState.COMPLETE

    @property
    def on_ground(self) -> bool | None:
        """Whether the vehicle stands on the ground, by its word, height and motion; see :class:`GroundContact`."""
        return self.ground.on_ground(self.time_s)

    def __call__(self, received: m.Received, now: float) -> None:
        """Take a message that arrived at ``now`` on the link's clock."""
        if self._vehicle is None or received.system_id != self._vehicle.system_id:
            return
        if received.component_id != self._vehicle.component_id:
            self._take_other(received)
            return
        message = received.message
        if self.has_gap(now) and self.heard_at_s > -math.inf:
            self.gap_s, self.gap_ended_at_s = now - self.heard_at_s, now
        self.heard_at_s = now
        if not isinstance(message, m.GlobalPositionInt | m.Attitude | m.SystemTime):
            self._take(message, now)
        elif self._believes(message.time_boot_s, now):
            # What this message proves came before it, and nothing of it is lost.
            for earlier in [*self._doubted[len(self._doubted) - self._time.proven :], message]:
                self._take(earlier, now)
            self._doubted.clear()
        else:
            self._doubt(message, now)

    def _take(self, message: m.Message, now: float) -> None:
        """Take a message of the vehicle that is believed."""
        if isinstance(message, m.GlobalPositionInt):
            self._doubted_since_s = None
            if message.lat_deg == 0.0 and message.lon_deg == 0.0:
                return  # how autopilots say that they do not know where they are
        if isinstance(message, m.Attitude) and not math.isfinite(
            message.roll_rad + message.pitch_rad + message.yaw_rad
        ):
            return  # it does not know its attitude
        self.counts[type(message)] += 1
        self._latest[type(message)] = message
        self._arrived_at_s[type(message)] = now
        match message:
            case m.Heartbeat():
                if self.beats and self.beats[-1][1].custom_mode != message.custom_mode:
                    self.mode_changes += 1
                    self.mode_changed_here = self.latest(m.GlobalPositionInt)
                self.beats.append((now, message))
            case m.TimeSync() if message.answered_ns != 0:
                self.time_answers.append((now, message))
            case m.GlobalPositionInt():
                self.position_at_s = now
                self.ground.take_position(message)
                self.positions.take(message)
                if self.on_position is not None:
                    self.on_position(message)
            case m.MissionAck(result=MissionResult.ACCEPTED, mission_type=MissionType.MISSION):
                self.uploads_taken += 1
            case m.ExtendedSysState():
                self.ground.take_word(message.landed_state, self.time_s)
            case m.MissionAck(result=MissionResult.ACCEPTED):
                self.lists_taken[message.mission_type] += 1
            case m.ParamValue():
                self.parameters[message.name] = message
            case m.CameraFeedback():
                self.photos_taken = message.number
            case m.CameraImageCaptured() if m.CameraFeedback not in self._latest:
                if message.success != 1:
                    self._failed_photos.add(message.number)
                # PX4 counts from 0, and numbers the photos that fail as well.
                failed = sum(number <= message.number for number in self._failed_photos)
                self.photos_taken = message.number + 1 - failed
            case m.MissionItemReached():
                self.reached = max(self.reached, message.seq)
            case m.TerrainRequest() if len(self.terrain_requested) < MONITOR.max_terrain_requested:
                self.terrain_requested.add(message)
            case m.AutopilotVersion():
                self.uids.add((message.uid, int.from_bytes(message.uid2, "big")))
            case m.Event():
                self.events.append(message)
            case m.StatusText():
                self.texts.extend(self._assembler.take(message))

    def _believes(self, stamp_s: float, now: float) -> bool:
        """Whether a message's time stamp is believed; what was said before a restart is over."""
        restarted = self._time.restarted
        believed = self._time.take(stamp_s, now)
        if self._time.restarted and not restarted:
            self._latest.clear()
            self.ground.forget()
            self.positions = TwoPositions()
        return believed

    def _doubt(self, message: m.Message, now: float) -> None:
        """Keep a message until its stamp is proven; a position counts as come meanwhile, for a moment."""
        self._doubted = [*self._doubted, message][-self._time.doubted :] if self._time.doubted else []
        if not isinstance(message, m.GlobalPositionInt):
            return
        if self._doubted_since_s is None:
            self._doubted_since_s = now
        if now - self._doubted_since_s <= MONITOR.doubt_s:
            self.position_at_s = now

    def _take_other(self, received: m.Received) -> None:
        """Show messages of other components of the vehicle's system to the pilot; they decide nothing."""
        said = received.message
        if isinstance(said, m.StatusText):
            assembler = self._other_assemblers.setdefault(received.component_id, TextAssembler())
            self.other_texts.extend((received.component_id, text) for text in assembler.take(said))


def open_vehicle(link: Link | str, *, timing: Timing | None = None, own_system: int = 255) -> tuple[Client, Monitor]:
    """A client on a link or a link's URL, with a monitor that hears everything it hears.

    Raises:
        mission_io.errors.MisuseError: a URL that is not understood.
        mission_io.errors.LinkError: the link cannot be opened.
    """
    monitor = Monitor()
    opened = open_link(link) if isinstance(link, str) else link
    return Client(opened, timing=timing, listener=monitor, system_id=own_system), monitor
