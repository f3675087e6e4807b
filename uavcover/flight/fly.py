"""Fly a mission: prepare, check, arm, start, follow, record, land; or return along checked legs."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mission_io.autopilots.autopilot import Mode
from mission_io.client.client import Client
from mission_io.data_tables import data_table
from mission_io.errors import MissionIoError, TransferSilentError, VehicleSilentError
from mission_io.wire import messages as m
from uavcover.errors import VehicleError
from uavcover.flight.arming import (
    arm_and_start,
    check_home,
    check_mission,
    disarm_on_ground,
    is_flying,
    request_telemetry,
    wait_until_ready,
)
from uavcover.flight.follow import PlanReturn, follow_mission, follow_taken, return_home
from uavcover.flight.limits import AppliedLimits, read_return_parameters, tell_returns_by
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import (
    PREPARATION,
    FlightPlan,
    FlightTimeouts,
    Orders,
    require_answers,
    require_multirotor,
    simulated_by,
)
from uavcover.flight.preconditions import Preconditions
from uavcover.flight.progress import MissionProgress, tell_short_battery
from uavcover.flight.session import Session, Stopped, TakenOverError
from uavcover.flight.watch import has_fix
from uavcover.model.limits import is_flight_time
from uavcover.model.track import (
    VELOCITY_COLUMNS,
    Ending,
    EventKind,
    FlightFailedError,
    FlightFaultError,
    FlightOutcome,
    TrackSample,
)
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class _Records:
    state_every_s: float
    line_every_s: float
    line_every_flown_s: float
    max_attitude_age_s: float


RECORDS = data_table(_Records, "uavcover/data/flight.toml", "records")


def fly(
    client: Client, monitor: Monitor, plan: FlightPlan, orders: Orders, *, plan_return: PlanReturn
) -> FlightOutcome:
    """Fly the mission that a vehicle on the ground holds, and record the flight.

    Args:
        client: talks to the vehicle; made with ``monitor`` as its listener, see ``open_vehicle``.
        monitor: receives everything that the client receives.
        plan: the mission that the vehicle must hold, and what was planned with it.
        orders: what the user wants, and who receives the events.
        plan_return: plans the checked return after a stop.

    Raises:
        FlightFailedError: the flight failed; the error says what happened and what the vehicle does now, and carries the
            outcome. All recorded samples have been delivered.
    """
    flight = FlightRun(client, monitor, orders)
    return flight.ended(lambda: _from_the_ground(flight, plan), plan_return)


class Recorder:
    """Makes a sample of each position, with the latest attitude and mission item.

    Late and duplicate positions are omitted, so that the track's time always increases. Without a current attitude, the sample
    has none, only the heading of the position message.
    """

    def __init__(
        self,
        monitor: Monitor,  # what the vehicle says
        frame: LocalFrame,  # the scenario's local frame
        *,
        waypoint_of: Callable[[int], int],  # number of the planned waypoint that a mission item is, -1 for the others
        on_sample: Callable[[TrackSample], None],  # takes the samples
        utc_offset_s: float = math.nan,  # from the link's clock to UTC; NaN: when a position arrived is not recorded
    ) -> None:
        self._monitor, self._frame, self._on_sample = monitor, frame, on_sample
        self._utc_offset_s = utc_offset_s
        self.waypoint_of = waypoint_of
        self.count = 0
        self.first_s = self.last_s = -math.inf
        self._reports_velocity = False

    def start(self) -> None:
        """Record from the next position on."""
        self._monitor.on_position = self._record

    def _record(self, position: m.GlobalPositionInt) -> None:
        if position.time_boot_s <= self.last_s:
            return
        self.last_s = position.time_boot_s
        if self.count == 0:
            self.first_s = position.time_boot_s
        self.count += 1
        attitude = self._monitor.latest(m.Attitude)
        age_s = math.nan if attitude is None else position.time_boot_s - attitude.time_boot_s
        roll = pitch = yaw = math.nan
        if attitude is not None and abs(age_s) <= RECORDS.max_attitude_age_s:
            roll, pitch, yaw = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad
        if math.isnan(yaw) and position.heading_deg is not None:
            yaw = math.radians(position.heading_deg)
        lat, lon, alt = position.lat_deg, position.lon_deg, position.alt_amsl_m
        east, north, up = self._frame.enu_from_geodetic(lat, lon, alt)[0].tolist()
        self._on_sample(
            TrackSample(
                time_s=position.time_boot_s,
                lat_deg=lat,
                lon_deg=lon,
                alt_amsl_m=alt,
                east_m=east,
                north_m=north,
                up_m=up,
                roll_deg=math.degrees(roll),
                pitch_deg=math.degrees(pitch),
                yaw_deg=math.degrees(yaw) % 360.0,
                current_waypoint=self.waypoint_of(self._monitor.current_seq),
                attitude_age_s=age_s,
                pictures_taken=math.nan if (taken := self._monitor.photos_taken) is None else float(taken),
                unix_time_s=self._unix_time_s(position.time_boot_s),
                received_utc_s=self._utc_offset_s + (self._monitor.position_at_s or 0.0),
                has_fix=has_fix(self._monitor),
                **self._velocity(position),
            )
        )

    def _velocity(self, position: m.GlobalPositionInt) -> dict[str, float]:
        """The velocity columns; empty before the first value that is not 0: zeros mean that none is reported."""
        velocity = {name: float(getattr(position, name)) for name in VELOCITY_COLUMNS}
        self._reports_velocity |= any(velocity.values())
        return velocity if self._reports_velocity else {}

    def _unix_time_s(self, time_boot_s: float) -> float:
        """UTC at a vehicle time, from the vehicle's clock; NaN before its receiver knows."""
        clock = self._monitor.latest(m.SystemTime)
        if clock is None or not is_flight_time(clock.time_unix_s):
            return math.nan
        return clock.time_unix_s + (time_boot_s - clock.time_boot_s)


class FlightRun:
    """State that every flight needs from its start to its end, from the ground or from the air."""

    def __init__(self, client: Client, monitor: Monitor, orders: Orders) -> None:
        self.orders = orders
        self.session = Session(
            client,
            monitor,
            timeouts=orders.timeouts if orders.timeouts is not None else FlightTimeouts(),
            on_event=orders.on_event,
            stop=orders.stop,
            pause=orders.pause,
        )
        self.precautions = orders.precautions
        self.limits = AppliedLimits(self.session, self.precautions)
        self._on_sample = orders.on_sample
        self.recorder: Recorder | None = None
        self.progress: MissionProgress | None = None
        self.preconditions: Preconditions | None = None
        self.simulator: str | None = None
        self.touched = False

    def find(self, refuse: Callable[[Session], None]) -> None:
        """Find the vehicle, and determine whether it is simulated.

        Args:
            refuse: raises if the vehicle does not fit.

        Raises:
            FlightFaultError: it may be real, and the user did not permit it to be flown.
            VehicleError: it is not a multirotor, or answers nothing.
        """
        client, monitor = self.session.client, self.session.monitor
        client.wait_for_vehicle()
        vehicle = require_multirotor(client)
        refuse(self.session)
        require_answers(client)
        monitor.listen_to(vehicle.address)
        monitor.begin()
        self.session.tell(EventKind.STAGE, f"vehicle {vehicle.system_id}, {vehicle.described}")
        self.simulator = simulated_by(client)
        if self.simulator is None and not self.orders.confirmed:
            raise FlightFaultError(
                Ending.NOT_ARMED,
                f"vehicle {vehicle.system_id} may be a real vehicle, so no command was sent; add --yes to fly it",
            )
        self.session.on_breach = self.precautions.on_breach
        self.session.photos_required = self.precautions.photos_required
        self.session.simulated = self.simulator is not None

    def watch_preconditions(self, plan: FlightPlan) -> Preconditions:
        """Watch the checks before arming; a change that affects returns checks the returns again."""
        session, returns = self.session, plan.returns

        def returns_changed(parameters: Mapping[str, float]) -> None:
            if returns is not None:
                tell_returns_by(session, returns, parameters, watched.rally)

        self.preconditions = watched = Preconditions(session, plan, self.limits.values, returns_changed=returns_changed)
        return watched

    def record(self, plan: FlightPlan) -> MissionProgress:
        """Record from the next position on, and count the planned waypoints."""
        session = self.session
        autopilot = session.autopilot
        if plan.ground_alt_amsl_m is not None:
            session.monitor.ground.know_ground(plan.ground_at, home_alt_amsl_m=plan.ground_alt_amsl_m)

        def waypoint_of(seq: int) -> int:
            """No planned waypoint is flown to while a pilot or another station has the vehicle, or made its mission."""
            astray = session.watch.is_open(Ending.MISSION_CHANGED) or not session.on_mission
            return -1 if astray else plan.waypoint_of(seq, autopilot)

        self.recorder = Recorder(
            session.monitor,
            plan.frame,
            waypoint_of=waypoint_of,
            on_sample=self._on_sample,
            utc_offset_s=self.orders.utc_offset_s,
        )
        self.progress = MissionProgress(session, plan)
        session.monitor.reached = -1
        self.recorder.start()
        return self.progress

    def home(self, plan_return: PlanReturn, cause: Ending | None) -> FlightOutcome:
        """Return along checked legs after a stop, a breach or a low battery; or leave the vehicle holding.

        Raises:
            FlightFaultError: it was a breach, or the return failed.
        """
        if self.progress is not None:
            self.progress.update()
        if not is_flying(self.session) and disarm_on_ground(self.session):
            return self.outcome(Ending.NOT_FLOWN)
        if self.recorder is not None:
            self.recorder.waypoint_of = lambda _: -1  # the items of the return are no planned waypoints
        try:
            landed = self._come_home(plan_return, 1 if cause is None else self.session.stop())
        except FlightFaultError as error:
            if cause is None or cause is Ending.RESERVE_KEPT or error.ending not in (Ending.FAILED, Ending.STUCK):
                raise
            raise FlightFaultError(cause, f"{self.session.watch.text_of(cause)}; {error}") from error
        if cause is not None:
            if cause is Ending.RESERVE_KEPT:
                if landed:
                    return self.outcome(cause)
                raise FlightFaultError(
                    Ending.BATTERY_LOW,
                    "the vehicle holds its position and is using its battery reserve; take manual control now",
                )
            how = "the vehicle returned along checked legs and landed" if landed else "the vehicle holds its position"
            raise FlightFaultError(cause, f"{self.session.watch.text_of(cause)}; {how}")
        return self.outcome(Ending.RETURNED if landed else Ending.LEFT_HOLDING)

    def _come_home(self, plan_return: PlanReturn, stops: int) -> bool:
        """Whether the vehicle landed; what something else has meanwhile is recorded until it is on the ground."""
        session = self.session
        while True:
            try:
                return return_home(
                    session, plan_return, stops=stops, preconditions=self.preconditions,
                    clear=self.orders.clearance.may_go_home,
                )  # fmt: skip
            except TakenOverError as error:
                session.alarm(str(error))
                if error.ending is Ending.STATE_UNKNOWN:
                    self._wait_until_known()
                    continue
                again, why = False, FlightFaultError(error.ending, str(error))
            except VehicleSilentError as error:
                session.alarm(f"{error}; uavcover still records the flight")
                again, why = True, FlightFaultError(Ending.FAILED, str(error))
            landed = not session.client.vehicle.armed
            stops = max(stops, session.stop())
            try:
                follow_taken(session)
            except Stopped:
                continue
            except FlightFaultError as error:
                if error.ending is Ending.STUCK and again:  # it holds, and may be heard again
                    continue
                raise
            if landed:
                return True
            raise FlightFaultError(why.ending, f"{why}; uavcover followed the vehicle until it landed and disarmed")

    def _wait_until_known(self) -> None:
        session, stops = self.session, self.session.stop()
        while not session.evidence.current:
            if session.stop() > stops:
                raise FlightFaultError(
                    Ending.STATE_UNKNOWN,
                    f"{session.watch.text_of(Ending.STATE_UNKNOWN)}; uavcover no longer follows the flight",
                )
            session.pump()

    def outcome(self, ending: Ending) -> FlightOutcome:
        """The outcome for an ending."""
        session, recorder = self.session, self.recorder
        recorded = recorder is not None and recorder.count > 0
        return FlightOutcome(
            ending=ending,
            waypoints_reached=0 if self.progress is None else self.progress.reached_count,
            sample_count=0 if recorder is None else recorder.count,
            duration_s=recorder.last_s - recorder.first_s if recorder is not None and recorded else 0.0,
            simulated_by=self.simulator,
            incidents=tuple(session.watch.incidents),
            vehicle_now=session.vehicle_now,
            limits=tuple(row.as_json() for row in self.limits.rows),
        )

    def ended(self, work: Callable[[], None], plan_return: PlanReturn) -> FlightOutcome:
        """Do the work, and return if it is stopped; every failure becomes an ending.

        Raises:
            FlightFailedError: it did not end as planned.
        """
        session = self.session
        try:
            try:
                work()
                outcome = self.outcome(Ending.LANDED)
            except Stopped as stop:
                outcome = self.home(plan_return, stop.cause)
        except (VehicleError, MissionIoError) as error:
            raise self._failed(error) from error
        finally:
            session.monitor.on_position = None
            self.limits.put_back()
        session.tell(EventKind.STAGE, outcome.ending.value)
        return outcome

    def _failed(self, error: VehicleError | MissionIoError) -> FlightFailedError:
        session = self.session
        silent = isinstance(error, VehicleSilentError | TransferSilentError)
        if isinstance(error, FlightFaultError):
            ending = error.ending
        elif silent and session.silence_s > session.timeouts.deadman_s:
            ending = Ending.LINK_LOST
        else:
            ending = Ending.FAILED if self.touched else Ending.NOT_ARMED
        if ending is Ending.RESTARTED:
            session.listen(PREPARATION.after_restart_s)
        text = str(error)
        if isinstance(error, MissionIoError):
            text += session.recent_warnings
        outcome = self.outcome(ending)
        if self.touched:
            text += f"; {outcome.vehicle_now}" if session.is_silent else f"; now: {outcome.vehicle_now}"
        return FlightFailedError(text, outcome)


def _from_the_ground(flight: FlightRun, plan: FlightPlan) -> None:
    session = flight.session
    flight.find(_refuse_armed)
    request_telemetry(session)
    wait_until_ready(session)
    check_home(session, plan)
    check_mission(session, plan)
    flight.limits.put_back_older()
    flight.limits.check(plan)
    watched = flight.watch_preconditions(plan)
    if plan.returns is not None:
        tell_returns_by(session, plan.returns, read_return_parameters(session), watched.rally)
    tell_short_battery(session, plan)
    while not flight.orders.clearance.may_start():  # beside other vehicles
        if session.stop():
            raise Stopped
        session.pump()
    session.prepare(lambda: _refuse_armed(session), while_in=tuple(Mode))
    flight.orders.on_begin()
    progress = flight.record(plan)
    flight.touched = True
    try:
        arm_and_start(session)
    except TakenOverError as error:
        if not session.client.vehicle.armed:
            raise
        session.alarm(str(error))  # and follow it: a pilot may fly it
    follow_mission(session, plan, progress, flight.orders.clearance.must_go_home, flight.preconditions)


def _refuse_armed(session: Session) -> None:
    vehicle = session.client.vehicle
    if vehicle.armed:
        raise FlightFaultError(
            Ending.NOT_ARMED,
            f"vehicle {vehicle.system_id} is already armed, in {session.mode_name}, so no command was sent; to "
            "continue a flight that ended early, use --resume",
        )
