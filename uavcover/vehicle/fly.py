"""One flight: get ready, check, arm, start, follow, record, land; or home along checked legs when the user stops it."""

from collections.abc import Callable
from dataclasses import dataclass

from mission_io.errors import MissionIoError, TransferSilentError, VehicleSilentError
from mission_io.wire import messages as m
from uavcover.errors import UavcoverError, VehicleError
from uavcover.model.track import TrackSample
from uavcover.vehicle.applied_limits import AppliedLimits
from uavcover.vehicle.client import VehicleClient
from uavcover.vehicle.flight_plan import FlightPlan, Patience
from uavcover.vehicle.follow import follow_mission
from uavcover.vehicle.modes import Mode, custom_mode, require_multirotor
from uavcover.vehicle.monitor import Monitor
from uavcover.vehicle.outcome import Ending, EventKind, FlightEvent, FlightFailedError, FlightFaultError, FlightOutcome
from uavcover.vehicle.precautions import OnBreach, Precautions, simulated_by
from uavcover.vehicle.progress import Progress
from uavcover.vehicle.readiness import (
    check_home,
    check_home_position,
    check_mission,
    check_telemetry,
    request_telemetry,
    wait_until_ready,
)
from uavcover.vehicle.recorder import Recorder
from uavcover.vehicle.return_home import PlanReturn, hold, return_home
from uavcover.vehicle.session import Conversation, Stopped
from uavcover.vehicle.start import (
    arm_and_start,
    disarm_on_ground,
    hold_mode,
    is_flying,
    set_current_item,
    start_mission,
    wire_seq,
)

__all__ = ["Ending", "FlightOutcome", "Onward", "fly", "fly_on"]


_AFTER_RESTART_S = 3.0
"""So long a vehicle that restarted is listened to, to say what it does now."""


@dataclass(frozen=True, slots=True)
class Onward:
    """How a vehicle in the air goes on.

    Attributes:
        plan: what it is to fly from here.
        upload: whether it has to be sent; otherwise the vehicle holds it already.
        first_item: index in ``plan.mission.items`` of the item that it flies to first.
    """

    plan: FlightPlan
    upload: bool
    first_item: int


PlanOnward = Callable[[float, float, float], Onward]
"""From latitude, longitude (degrees) and height above sea level (metres), how to go on; every leg of it was checked."""


def fly(
    client: VehicleClient,
    monitor: Monitor,
    plan: FlightPlan,
    *,
    on_sample: Callable[[TrackSample], None],
    on_event: Callable[[FlightEvent], None],
    on_begin: Callable[[], None] = lambda: None,
    plan_return: PlanReturn,
    stop: Callable[[], int] = lambda: 0,
    pause: Callable[[], bool] = lambda: False,
    confirmed: bool = False,
    patience: Patience | None = None,
    precautions: Precautions | None = None,
) -> FlightOutcome:
    """Fly the mission that the vehicle on the ground holds, and record it.

    Args:
        client: talks to the vehicle; made with ``monitor`` as its listener, see ``open_vehicle``.
        monitor: hears all that the client hears.
        plan: what the vehicle is to hold, and where it belongs.
        on_sample: takes every sample as it comes, also when the flight ends in an error.
        on_event: is told what happens.
        on_begin: is called when all is checked, before the vehicle is armed; what it raises keeps it on the ground.
        plan_return: makes the checked way home after a stop, from latitude, longitude and height above sea level.
        stop: how often the user has asked to stop (Ctrl-C): once is home, twice is hold.
        pause: whether the user wants the vehicle to wait where it is; as soon as no longer, it goes on.
        confirmed: whether the user said that a real vehicle may be armed.
        patience: how long to wait for what.
        precautions: what to do when it goes wrong, and before; None only tells.

    Raises:
        FlightFailedError: the flight did not end as it should; it says what happened and what the vehicle does now, and
            carries the outcome with its name. Nothing that was recorded is lost.
    """
    flight = _Flight(client, monitor, patience, precautions, on_event, on_sample, stop, pause)
    return flight.ended(lambda: _from_the_ground(flight, plan, plan_return, on_begin, confirmed=confirmed))


def fly_on(
    client: VehicleClient,
    monitor: Monitor,
    plan_onward: PlanOnward,
    *,
    on_sample: Callable[[TrackSample], None],
    on_event: Callable[[FlightEvent], None],
    on_begin: Callable[[], None] = lambda: None,
    plan_return: PlanReturn,
    stop: Callable[[], int] = lambda: 0,
    pause: Callable[[], bool] = lambda: False,
    confirmed: bool = False,
    patience: Patience | None = None,
    precautions: Precautions | None = None,
) -> FlightOutcome:
    """Take over a vehicle that is in the air, and fly on with what is left of a plan; the arguments are those of ``fly``.

    The vehicle is told to hold first. One that is neither in its mission nor holding is not touched: a pilot or a failsafe
    has it.

    Args:
        client: talks to the vehicle.
        monitor: hears all that the client hears.
        plan_onward: makes the checked way from where the vehicle holds.
        on_sample: takes every sample as it comes.
        on_event: is told what happens.
        on_begin: is called before the vehicle is told anything; what it raises ends it there.
        plan_return: makes the checked way home after a stop.
        stop: how often the user has asked to stop.
        pause: whether the user wants the vehicle to wait where it is.
        confirmed: whether the user said that a real vehicle may be commanded.
        patience: how long to wait for what.
        precautions: what to do when it goes wrong, and before; None only tells.

    Raises:
        FlightFailedError: as ``fly``.
    """
    flight = _Flight(client, monitor, patience, precautions, on_event, on_sample, stop, pause)
    return flight.ended(lambda: _from_the_air(flight, plan_onward, plan_return, on_begin, confirmed=confirmed))


class _Flight:
    """What a flight has from its begin to its end, however it begins and ends."""

    def __init__(
        self,
        client: VehicleClient,
        monitor: Monitor,
        patience: Patience | None,
        precautions: Precautions | None,
        on_event: Callable[[FlightEvent], None],
        on_sample: Callable[[TrackSample], None],
        stop: Callable[[], int],
        pause: Callable[[], bool],
    ) -> None:
        patience = patience if patience is not None else Patience()
        self.conversation = Conversation(client, monitor, patience=patience, on_event=on_event, stop=stop, pause=pause)
        self.precautions = precautions if precautions is not None else Precautions(on_breach=OnBreach.TELL)
        self.limits = AppliedLimits(self.conversation, self.precautions)
        self._on_sample = on_sample
        self.recorder: Recorder | None = None
        self.progress: Progress | None = None
        self.simulator: str | None = None
        self.touched = False

    def find(self, refuse: Callable[[Conversation], None], *, confirmed: bool) -> None:
        """Find the vehicle, and out whether it is simulated.

        Args:
            refuse: raises when the vehicle is not as it has to be.
            confirmed: whether the user said that a real vehicle may be flown.

        Raises:
            FlightFaultError: it may be real, and the user did not say that it may be flown.
            VehicleError: it is no multirotor.
        """
        client, monitor = self.conversation.client, self.conversation.monitor
        client.wait_for_vehicle()
        vehicle = require_multirotor(client)
        refuse(self.conversation)
        monitor.listen_to(vehicle.address)
        monitor.begin()
        self.conversation.tell(EventKind.STAGE, f"vehicle {vehicle.system_id}, {vehicle.described}")
        self.simulator = simulated_by(client)
        if self.simulator is None and not confirmed:
            raise FlightFaultError(
                Ending.NOT_ARMED,
                f"nothing proves that vehicle {vehicle.system_id} is simulated; say --yes to fly a real vehicle; not touched",
            )
        self.conversation.on_breach = self.precautions.reaction(simulated=self.simulator is not None)

    def record(self, plan: FlightPlan) -> Progress:
        """Record from the next position on, and count the planned waypoints."""
        conversation = self.conversation
        autopilot = conversation.autopilot
        if plan.ground_alt_amsl_m is not None:
            conversation.monitor.ground.know_ground(plan.ground_at, home_alt_amsl_m=plan.ground_alt_amsl_m)

        def waypoint_of(seq: int) -> int:
            """No planned waypoint is flown to while somebody else has the vehicle, or made its mission."""
            astray = conversation.watch.is_open(Ending.MISSION_CHANGED) or not conversation.obeys
            return -1 if astray else plan.waypoint_of(seq, autopilot)

        self.recorder = Recorder(
            conversation.monitor,
            plan.frame,
            waypoint_of=waypoint_of,
            on_sample=self._on_sample,
        )
        self.progress = Progress(conversation, plan)
        conversation.monitor.reached = -1
        self.recorder.start()
        return self.progress

    def home(self, plan_return: PlanReturn, cause: Ending | None) -> FlightOutcome:
        """After the user's stop, or a breach: home along checked legs, or left holding.

        Raises:
            FlightFaultError: it was a breach, or the way home failed.
        """
        if self.progress is not None:
            self.progress.update()
        if not is_flying(self.conversation) and disarm_on_ground(self.conversation):
            return self.outcome(Ending.NOT_FLOWN)
        if self.recorder is not None:
            self.recorder.waypoint_of = lambda _: -1  # the items of the way home are no planned waypoints
        if cause is None:
            landed = return_home(self.conversation, plan_return)
        else:
            landed = return_home(self.conversation, plan_return, stops=self.conversation.stop())
            how = "it was flown home along checked legs, and landed" if landed else "it was left holding"
            raise FlightFaultError(cause, f"{self.conversation.watch.text_of(cause)}; {how}")
        return self.outcome(Ending.RETURNED if landed else Ending.LEFT_HOLDING)

    def outcome(self, ending: Ending) -> FlightOutcome:
        """How it ended."""
        conversation, recorder = self.conversation, self.recorder
        recorded = recorder is not None and recorder.count > 0
        return FlightOutcome(
            ending=ending,
            waypoints_reached=0 if self.progress is None else self.progress.reached_count,
            sample_count=0 if recorder is None else recorder.count,
            duration_s=recorder.last_s - recorder.first_s if recorder is not None and recorded else 0.0,
            simulated_by=self.simulator,
            incidents=tuple(conversation.watch.incidents),
            vehicle_now=conversation.vehicle_now,
            limits=tuple(row.as_json() for row in self.limits.rows),
        )

    def ended(self, work: Callable[[], FlightOutcome]) -> FlightOutcome:
        """Do the work; whatever goes wrong gets the name of an ending.

        Raises:
            FlightFailedError: it did not end as it should.
        """
        conversation = self.conversation
        try:
            outcome = work()
        except (VehicleError, MissionIoError) as error:
            raise self._failed(error) from error
        finally:
            conversation.monitor.on_position = None
            self.limits.put_back()
        conversation.tell(EventKind.STAGE, outcome.ending.value)
        return outcome

    def _failed(self, error: VehicleError | MissionIoError) -> FlightFailedError:
        conversation = self.conversation
        silent = isinstance(error, VehicleSilentError | TransferSilentError)
        if isinstance(error, FlightFaultError):
            ending = error.ending
        elif silent and conversation.silence_s > conversation.patience.deadman_s:
            ending = Ending.LINK_LOST
        else:
            ending = Ending.FAILED if self.touched else Ending.NOT_ARMED
        if ending is Ending.RESTARTED:
            conversation.listen(_AFTER_RESTART_S)
        text = str(error)
        if isinstance(error, MissionIoError):
            text += conversation.complaints
        outcome = self.outcome(ending)
        if self.touched:
            text += f"; now: {outcome.vehicle_now}"
        return FlightFailedError(text, outcome)


def _from_the_ground(
    flight: _Flight, plan: FlightPlan, plan_return: PlanReturn, on_begin: Callable[[], None], *, confirmed: bool
) -> FlightOutcome:
    conversation = flight.conversation
    flight.find(_refuse_armed, confirmed=confirmed)
    try:
        request_telemetry(conversation)
        wait_until_ready(conversation)
        check_home(conversation, plan)
        check_mission(conversation, plan)
        flight.limits.put_back_older()
        flight.limits.check(plan)
        _refuse_armed(conversation)
        on_begin()
        progress = flight.record(plan)
        flight.touched = True
        arm_and_start(conversation)
        follow_mission(conversation, plan, progress)
    except Stopped as stop:
        return flight.home(plan_return, stop.cause)
    return flight.outcome(Ending.LANDED)


def _from_the_air(
    flight: _Flight, plan_onward: PlanOnward, plan_return: PlanReturn, on_begin: Callable[[], None], *, confirmed: bool
) -> FlightOutcome:
    conversation = flight.conversation
    flight.find(_refuse_taken, confirmed=confirmed)
    try:
        request_telemetry(conversation)
        check_telemetry(conversation)
        on_begin()
        hold(conversation, "the vehicle is told to hold")
        flight.touched = True
        here = conversation.monitor.latest(m.GlobalPositionInt)
        if here is None:
            raise FlightFaultError(Ending.POSITION_LOST, "the vehicle does not tell where it is; it was left holding")
        try:
            onward = plan_onward(here.lat_deg, here.lon_deg, here.alt_amsl_m)
        except UavcoverError as error:
            raise FlightFaultError(Ending.FAILED, f"no checked way on from here: {error}; left holding") from error
        plan = onward.plan
        check_home_position(conversation, plan)
        if onward.upload:
            conversation.tell(EventKind.STAGE, "the rest of the mission is being sent")
            client = conversation.client
            if not conversation.insist(lambda: client.upload_and_verify(plan.mission, in_flight=True)).passed:
                raise FlightFaultError(
                    Ending.FAILED, "the rest of the mission was read back changed; the vehicle was left holding"
                )
        if conversation.stop():
            raise Stopped
        seq = wire_seq(conversation, onward.first_item)
        conversation.insist(lambda: set_current_item(conversation, seq))
        conversation.monitor.forget(m.MissionCurrent)
        progress = flight.record(plan)
        conversation.insist(lambda: start_mission(conversation))
        conversation.watch.take_off()
        conversation.tell(EventKind.STAGE, "going on with the mission")
        follow_mission(conversation, plan, progress)
    except Stopped as stop:
        return flight.home(plan_return, stop.cause)
    return flight.outcome(Ending.LANDED)


def _refuse_armed(conversation: Conversation) -> None:
    vehicle = conversation.client.vehicle
    if vehicle.armed:
        raise FlightFaultError(
            Ending.NOT_ARMED,
            f"vehicle {vehicle.system_id} is armed already, in {conversation.mode_name}; not touched; --resume goes on with "
            "a flight that ended early",
        )


def _refuse_taken(conversation: Conversation) -> None:
    """Refuse a vehicle that is neither in its mission nor holding."""
    allowed = {custom_mode(conversation.autopilot, mode) for mode in (Mode.MISSION, Mode.HOLD, hold_mode(conversation))}
    if conversation.client.vehicle.custom_mode not in allowed:
        raise FlightFaultError(
            Ending.NOT_ARMED,
            f"vehicle {conversation.client.vehicle.system_id} is in the air in {conversation.mode_name}: a pilot or a failsafe "
            "has it; not touched; let it land, or change it to hold, and resume then",
        )
