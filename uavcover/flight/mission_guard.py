"""Whether a vehicle still flies the planned mission, in the commanded mode, and inside its operating volume.

The mission is read back while it is flown, without disturbing the flight.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from mission_io.autopilots.autopilot import Mode
from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.autopilots.mission_lists import wire_items
from mission_io.data_tables import data_table
from mission_io.errors import FormatError, MissionIoError, TransferCancelledError
from mission_io.model.items import MissionItem, MissionType
from mission_io.model.plain_text import counted
from mission_io.wire import messages as m
from uavcover.flight.orders import FlightPlan, OperatingVolume, custom_mode
from uavcover.flight.progress import MissionProgress
from uavcover.flight.session import Session, Timer
from uavcover.model.track import Ending, FlightFaultError


@dataclass(frozen=True, slots=True, kw_only=True)
class _Guard:
    every_s: float
    busy_fraction: float
    longest_s: float
    again_s: float
    look_s: float
    settle_s: float
    doubt_s: float
    off_doubt_s: float
    off_route_radii: float
    leans_deg: float
    comes_back_m_s: float
    cause_within_s: float
    warned_within_s: float
    band_slack_m: float
    fence_slack_m: float


GUARD = data_table(_Guard, "uavcover/data/flight.toml", "guard")


class ListReading:
    """Compare a list of the vehicle with the expected one at each sign of a change, and periodically.

    Positions that arrive meanwhile are recorded as usual, and continuous checks go on. The user's stop or pause ends a reading at
    once. A failed reading is repeated, later each time.

    Attributes:
        held: the list at the last reading.
        requested: whether to read it as soon as possible.
    """

    def __init__(
        self,
        session: Session,  # with the vehicle
        wanted: Sequence[MissionItem],  # what it is to hold, in wire order
        meanwhile: Callable[[], None],  # what else has to be done all the time
        *,
        mission_type: MissionType = MissionType.MISSION,  # which list
        every_s: float = GUARD.every_s,  # vehicle time between two periodic readings
    ) -> None:
        self._session, self._meanwhile = session, meanwhile
        self._wanted, self._type = tuple(wanted), mission_type
        self._every = Timer(session, every_s)
        self.held: tuple[MissionItem, ...] = self._wanted
        self.requested = False
        self._failures = 0
        self._not_before_s = self._rest_until_s = 0.0

    def ask(self) -> None:
        """Read as soon as possible, because of a sign of a change."""
        self.requested = True

    @property
    def due(self) -> bool:
        """Whether it is time to read."""
        now = self._session.client.clock.now()
        if self._session.watch.unanswered:
            return False
        return now >= self._not_before_s and (self.requested or (self._every.over and now >= self._rest_until_s))

    def difference(self) -> str | None:
        """The largest difference from the expected list; None without one, or when reading failed.

        Raises:
            FlightFaultError: the vehicle is gone, or it restarted.
        """
        session, began_s = self._session, self._session.client.clock.now()
        stops, pause, mode = session.stop(), session.pause(), session.client.vehicle.custom_mode
        self.requested = False

        looked_s = began_s

        def stop() -> bool:
            nonlocal looked_s
            now = session.client.clock.now()
            if now - looked_s < GUARD.look_s:  # asked after every message; a busy vehicle sends thousands
                return False
            looked_s = now
            session.attend()
            self._meanwhile()
            wanted_else = session.stop() != stops or session.pause() != pause
            wanted_else = wanted_else or session.client.vehicle.custom_mode != mode  # which is not ours to wait with
            return wanted_else or now - began_s > GUARD.longest_s

        try:
            held = session.client.download(self._type, stop=stop)
        except FormatError as error:
            held = None
            difference = f"the vehicle's mission does not match any plan: {error}"
        except TransferCancelledError:
            if session.client.clock.now() - began_s > GUARD.longest_s:
                self._note_failure(f"no complete answer within {GUARD.longest_s:g} s")
            self.requested = True
            return None
        except MissionIoError as error:
            self._note_failure(str(error))
            return None
        now = session.client.clock.now()
        if self._failures:
            session.warn(f"uavcover can read back the {self._name} again")
        self._failures = 0
        self._rest_until_s = now + (now - began_s) / GUARD.busy_fraction
        self._not_before_s = now + max(1.0, now - began_s)
        self._every.restart()
        if held is None:
            return difference
        self.held = held
        return fault_text(compare_items(self._wanted, held, session.autopilot, self._type))

    @property
    def _name(self) -> str:
        return {MissionType.FENCE: "fence", MissionType.RALLY: "list of rally points"}.get(self._type, "mission")

    def _note_failure(self, why: str) -> None:
        """Try again later; report the first failure."""
        if not self._failures:
            self._session.warn(f"cannot read back the {self._name} in flight: {why}; uavcover keeps trying")
        self._not_before_s = self._session.client.clock.now() + GUARD.again_s * 2.0 ** min(self._failures, 4)
        self._failures += 1
        self.requested = True


class ModeOverride:
    """Whether a pilot or a failsafe has overridden the commanded mode.

    Attributes:
        cause: the reason; None while the vehicle is in the commanded mode, or has only just left it.
        text: its reported text.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._left: Timer | None = None
        self.cause: Ending | None = None
        self.text = ""

    @property
    def begun(self) -> bool:
        """Whether the vehicle is in another mode than the commanded one."""
        return self._left is not None

    def update(self, expected: Collection[Mode]) -> None:
        """Check the mode; ``expected`` are the commanded ones."""
        session = self._session
        numbers = [custom_mode(session.autopilot, mode) for mode in expected]
        if self._left is not None and session.monitor.ground.reports_landed:
            self.settle()  # PX4 returns to the commanded mode after landing: that does not end an override
        elif session.client.vehicle.custom_mode in numbers:
            if self.cause is not None:
                session.watch.given_back(f"the vehicle is back in {session.mode_name}")
            self._left = self.cause = None
        elif self._left is None:
            self._left = Timer(session, GUARD.settle_s)
        elif self._left.over:
            self.settle()

    def settle(self) -> None:
        """Determine the cause now if the vehicle has left its mode."""
        if self._left is None or self.cause is not None:
            return
        session = self._session
        found = session.watch.cause_of_mode_change()
        self.cause = found.kind
        self.text = f"the vehicle changed to {session.mode_name}: {found.text}"
        session.watch.taken(self.cause, self.text, found.evidence)


_WHY = {
    Ending.WIND_ABOVE_LIMITS: ", because the wind is too strong",
    Ending.OFF_ROUTE: ", although it has the planned mission; the cause is unknown",
}


class MissionGuard:
    """Detects that another ground station changed the mission or its current item, and that the vehicle leaves its route.

    The mission is read back and compared every minute, and at each sign of a change: the vehicle's word for it, another mission
    id or number of items, an upload that another station was thanked for, waypoints that are omitted, going back. So it is far
    off the planned leg, which else is the wind's doing when the vehicle leans hard against it.

    Args:
        session: with the vehicle.
        plan: what it is to fly.
        progress: along it.
        meanwhile: what has to be done all the time, also while the mission is being read.
    """

    def __init__(
        self, session: Session, plan: FlightPlan, progress: MissionProgress, meanwhile: Callable[[], None]
    ) -> None:
        self._session, self._plan, self._progress = session, plan, progress
        self._reading = ListReading(session, wire_items(plan.mission, session.autopilot), meanwhile)
        self._found: str | None = None
        self._mission_id = 0
        self._words, self._uploads = session.watch.mission_words, session.monitor.uploads_taken
        self._total: int | None = None
        self._farthest = -1
        self._doubt: Timer | None = None
        self._off_route: Timer | None = None

    def look(self) -> None:
        """Look for signs; called while the vehicle is in its mission and in the air."""
        if not self._session.watch.is_open(Ending.MISSION_CHANGED):
            self._look_at_total()
            self._look_at_item()
            self.look_at_position()
        self._look_for_words()
        if self._reading.due:
            self._read_back()

    def look_once_more(self) -> None:
        """Check again after the landing: a change in the last minute counts. A vehicle that is off is not asked."""
        if self._session.watch.is_open(Ending.MISSION_CHANGED):
            return
        try:
            self._read_back()
        except FlightFaultError as error:
            self._session.warn(f"cannot read back the mission after the landing: {error}")

    def _look_at_total(self) -> None:
        current = self._session.monitor.latest(m.MissionCurrent)
        if current is None or current.total is None:
            return
        if self._total is None:
            self._total = current.total
        if current.total != self._total:
            self._changed(
                f"the vehicle's mission has {counted(current.total, 'item')} instead of {self._total}: another station "
                "changed the mission"
            )
            self._reading.ask()

    def _look_for_words(self) -> None:
        """Look for texts that report a changed mission without its content."""
        current, words = self._session.monitor.latest(m.MissionCurrent), self._session.watch.mission_words
        mission_id = 0 if current is None else current.mission_id
        uploads = self._session.monitor.uploads_taken
        other_id = mission_id not in (0, self._mission_id) and self._mission_id != 0
        if other_id or words != self._words or uploads != self._uploads:
            self._reading.ask()
        self._mission_id, self._words, self._uploads = mission_id or self._mission_id, words, uploads

    def _look_at_item(self) -> None:
        sign = self._wrong_item()
        if sign is None:
            self._doubt = None
        elif self._doubt is None:
            self._doubt = Timer(self._session, GUARD.doubt_s)
        elif self._doubt.over:
            self._doubt = None
            self._changed(f"{sign}: another station set the current item, or changed the mission")
            self._reading.ask()

    def _wrong_item(self) -> str | None:
        current = self._session.monitor.latest(m.MissionCurrent)
        number, progress = self._progress.heading_for, self._progress
        if current is None:
            return None
        self._farthest = max(self._farthest, number)
        past = self._plan.is_past_waypoints(current.seq, self._session.autopilot) and not progress.all_reached
        if number > progress.reached_count + 1 or (past and progress.reached_count < self._plan.waypoint_count - 1):
            return f"the vehicle is flying to item {current.seq} and skips waypoint {progress.reached_count}"
        return self._item_set_back(current.seq)

    def _item_set_back(self, seq: int) -> str | None:
        """Whether the current item is before a waypoint that was flown to, which no mission of ours does."""
        number = self._progress.heading_for
        if 0 <= number < self._farthest:
            return f"the vehicle is flying back to waypoint {number} from waypoint {self._farthest}"
        before = self._plan.index_of(seq, self._session.autopilot) < self._plan.first_waypoint_item
        if self._farthest >= 0 and before and not self._progress.all_reached:
            return f"the vehicle is flying back to item {seq}, before its route, from waypoint {self._farthest}"
        return None

    def look_at_position(self) -> None:
        """Check the distance to the leg; called in the air, in its mission, a hold or an unknown mode."""
        session, off_m = self._session, self._progress.off_leg_m
        watch = session.watch
        if watch.is_open(Ending.POSITION_LOST):
            return  # the leg goes on, the last known place does not
        if off_m <= GUARD.off_route_radii * self._plan.acceptance_radius_m:
            self._off_route = None
            for kind in (Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS):
                watch.measure(kind, None, "", "the vehicle is back near its planned leg")
            return
        lean_deg = self._lean_toward_leg_deg()
        if self._off_route is None:
            self._off_route = Timer(session, GUARD.off_doubt_s)
            return
        text = f"the vehicle is {off_m:.0f} m off the planned leg to item {session.monitor.current_seq}"
        for kind in (Ending.WIND_ABOVE_LIMITS, Ending.OFF_ROUTE, Ending.MISSION_CHANGED):
            if watch.is_open(kind):
                if kind is not Ending.MISSION_CHANGED:
                    watch.open(kind, f"{text}{_WHY[kind]}", off_m)
                return
        if not self._off_route.over:
            return
        sign = self._wrong_item()
        if sign is not None:
            self._changed(f"{text}: {sign}: another station set the current item, or changed the mission")
            self._reading.ask()
            return
        self._read_back(text)
        if watch.is_open(Ending.MISSION_CHANGED):
            return
        position = watch.causes.recent(within_s=GUARD.cause_within_s, among=(Ending.GPS_LOST,))
        wind = watch.causes.recent(within_s=GUARD.warned_within_s, among=(Ending.WIND_ABOVE_LIMITS,))
        leans = f"the vehicle is tilted by {lean_deg:.0f} degrees toward its leg, but drifts away from it"
        if position is not None:
            watch.open(
                Ending.OFF_ROUTE, f"{text}, but the position may be wrong: {position.text}", off_m,
                evidence=position.evidence,
            )  # fmt: skip
        elif wind is not None or lean_deg > GUARD.leans_deg:
            evidence = (*(() if wind is None else wind.evidence), *([leans] if lean_deg > GUARD.leans_deg else []))
            watch.open(Ending.WIND_ABOVE_LIMITS, f"{text}{_WHY[Ending.WIND_ABOVE_LIMITS]}", off_m, evidence=evidence)
        else:
            watch.open(Ending.OFF_ROUTE, f"{text}{_WHY[Ending.OFF_ROUTE]}", off_m)

    def _lean_toward_leg_deg(self) -> float:
        """Lean toward its leg without progress: the reaction of its controller to a wind that pushes it away."""
        attitude, toward = self._session.monitor.latest(m.Attitude), self._progress.off_leg_toward_m
        if attitude is None or toward is None:
            return 0.0
        east, north, _ = toward.tolist()
        length, here = math.hypot(east, north), self._session.monitor.latest(m.GlobalPositionInt)
        if length == 0.0 or here is None:
            return 0.0
        if (here.velocity_east_m_s * east + here.velocity_north_m_s * north) / length > GUARD.comes_back_m_s:
            return 0.0
        yaw = attitude.yaw_rad
        forward, right = math.tan(-attitude.pitch_rad), math.tan(attitude.roll_rad)
        lean_north = forward * math.cos(yaw) - right * math.sin(yaw)
        lean_east = forward * math.sin(yaw) + right * math.cos(yaw)
        return math.degrees(math.atan((lean_east * east + lean_north * north) / length))

    def _changed(self, text: str) -> None:
        self._session.watch.open(Ending.MISSION_CHANGED, text)

    def _read_back(self, sign: str = "") -> None:
        """Read the mission, and report each difference from the planned one once."""
        difference, watch = self._reading.difference(), self._session.watch
        if difference is not None and difference != self._found:
            self._found = difference
            if watch.is_open(Ending.MISSION_CHANGED):
                self._session.alarm(f"further change to the vehicle's mission: {difference}")
            else:
                position = f"{sign}: " if sign else ""
                self._changed(f"{position}another station changed the mission in flight: {difference}")


class VolumeWatch:
    """Warns when the vehicle leaves its fence, the height band of its route, or the ground that is known.

    Args:
        session: with the vehicle.
        volume: the plan's operating volume; None when it has none.
        progress: progress along the plan.
    """

    def __init__(self, session: Session, volume: OperatingVolume | None, progress: MissionProgress) -> None:
        self._watch, self._around, self._progress = session.watch, volume, progress

    def look(self, *, on_route: bool) -> None:
        """Look at the latest position; called while the vehicle is in the air.

        Args:
            on_route: whether it flies its mission, or holds on its way.
        """
        around, position_m = self._around, self._progress.position_m
        if around is None or position_m is None:
            return
        east_m, north_m, up_m = position_m.tolist()
        outside_m = around.outside_fence_m(east_m, north_m)
        self._watch.measure(
            Ending.FENCE_BREACHED, outside_m if outside_m > GUARD.fence_slack_m else None,
            f"the vehicle is {outside_m:.0f} m outside its fence", "the vehicle is inside its fence again",
        )  # fmt: skip
        height_m = up_m - around.ground_up_m(east_m, north_m)
        unknown = math.isnan(height_m)
        self._watch.measure(
            Ending.GROUND_UNKNOWN, 0.0 if unknown else None,
            "the height above ground is unknown: there is no elevation data below the vehicle",
            "the height above ground is known again",
        )  # fmt: skip
        on_route = on_route and self._progress.heading_for > 0
        outside_m, text = self._outside_band(around, height_m) if on_route and not unknown else (0.0, "")
        self._watch.measure(
            Ending.BAND_LEFT, outside_m if outside_m > GUARD.band_slack_m else None, text,
            "the vehicle is in its height band again" if on_route else "the vehicle has left the planned route",
        )  # fmt: skip

    @staticmethod
    def _outside_band(around: OperatingVolume, height_m: float) -> tuple[float, str]:
        low_m, high_m = around.min_height_agl_m - height_m, height_m - around.max_height_agl_m
        side, outside_m = ("below", low_m) if low_m > high_m else ("above", high_m)
        band = f"{around.min_height_agl_m:g} to {around.max_height_agl_m:g} m"
        return (
            outside_m,
            f"the vehicle is {height_m:.0f} m above the ground, {outside_m:.0f} m {side} its band of {band}",
        )
