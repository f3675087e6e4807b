"""One flight: get ready, check, arm, start, follow, record, land; or home along checked legs when the user stops it."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from mission_io.client import Client
from mission_io.errors import MissionIoError
from uavcover.errors import VehicleError
from uavcover.flight.conversation import Conversation, Stopped
from uavcover.flight.events import EventKind, FlightEvent
from uavcover.flight.flight_plan import FlightPlan, Patience
from uavcover.flight.follow import Progress, follow, longest_wait_s
from uavcover.flight.monitor import Monitor
from uavcover.flight.readiness import check_home, check_mission, request_telemetry, wait_until_ready
from uavcover.flight.recorder import Recorder
from uavcover.flight.return_home import PlanReturn, return_home
from uavcover.flight.simulation import simulated_by
from uavcover.flight.start import arm_and_start, disarm_on_ground, is_flying
from uavcover.model.track import TrackSample


class Ending(Enum):
    """How a flight ended without an error."""

    LANDED = "flown to the end, landed and disarmed"
    RETURNED = "stopped by the user, flown home along checked legs, landed and disarmed"
    LEFT_HOLDING = "stopped by the user and left holding, armed and in the air"
    NOT_FLOWN = "stopped by the user before it left the ground; disarmed"


@dataclass(frozen=True, slots=True)
class FlightOutcome:
    """How a flight ended.

    Attributes:
        ending: how.
        waypoints_reached: how many planned waypoints were reached.
        sample_count: how many samples were recorded.
        duration_s: vehicle time from the first sample to the last.
        simulated_by: what simulates the vehicle; None for one that may be real.
    """

    ending: Ending
    waypoints_reached: int
    sample_count: int
    duration_s: float
    simulated_by: str | None


def fly(
    client: Client,
    monitor: Monitor,
    plan: FlightPlan,
    *,
    on_sample: Callable[[TrackSample], None],
    on_event: Callable[[FlightEvent], None],
    plan_return: PlanReturn,
    stop: Callable[[], int] = lambda: 0,
    confirmed: bool = False,
    patience: Patience | None = None,
) -> FlightOutcome:
    """Fly the mission that the vehicle holds, and record it.

    Args:
        client: talks to the vehicle; made with ``monitor`` as its listener, see ``open_vehicle``.
        monitor: hears all that the client hears.
        plan: what the vehicle is to hold, and where it belongs.
        on_sample: takes every sample as it comes, also when the flight ends in an error.
        on_event: is told what happens.
        plan_return: makes the checked way home after a stop, from latitude, longitude and height above sea level.
        stop: how often the user has asked to stop (Ctrl-C): once is home, twice is hold.
        confirmed: whether the user said that a real vehicle may be armed.
        patience: how long to wait for what.

    Raises:
        VehicleError: no vehicle, one that is not what was planned for, one that refuses (with the result's name), or
            one that is lost; the message says which, and nothing that was recorded is lost.
    """
    conversation = Conversation(
        client, monitor, patience=patience if patience is not None else Patience(), on_event=on_event, stop=stop
    )
    try:
        return _fly(conversation, plan, on_sample=on_sample, plan_return=plan_return, confirmed=confirmed)
    except MissionIoError as error:
        raise VehicleError(f"{error}{conversation.complaints}") from error
    finally:
        monitor.on_position = None


def _fly(
    conversation: Conversation,
    plan: FlightPlan,
    *,
    on_sample: Callable[[TrackSample], None],
    plan_return: PlanReturn,
    confirmed: bool,
) -> FlightOutcome:
    client, monitor = conversation.client, conversation.monitor
    vehicle = client.wait_for_vehicle()
    monitor.listen_to(vehicle.system_id)
    autopilot = vehicle.autopilot
    conversation.tell(EventKind.STAGE, f"vehicle {vehicle.system_id}, {autopilot.name}")
    _refuse_armed(conversation)
    simulator = simulated_by(client)
    if simulator is None and not confirmed:
        raise VehicleError(
            f"nothing proves that vehicle {vehicle.system_id} is simulated; say --yes to arm a real vehicle; not armed"
        )
    recorder = Recorder(
        monitor, plan.frame, waypoint_of=lambda seq: plan.waypoint_of(seq, autopilot), on_sample=on_sample
    )
    progress = Progress(conversation, plan)

    def outcome(ending: Ending) -> FlightOutcome:
        duration_s = recorder.last_s - recorder.first_s if recorder.count else 0.0
        conversation.tell(EventKind.STAGE, ending.value)
        return FlightOutcome(ending, progress.reached_count, recorder.count, duration_s, simulator)

    try:
        request_telemetry(conversation)
        wait_until_ready(conversation)
        check_home(conversation, plan)
        check_mission(conversation, plan)
        _refuse_armed(conversation)
        monitor.reached = -1
        recorder.start()
        arm_and_start(conversation)
        follow(conversation, progress=progress, longest_wait_s=longest_wait_s(plan), stops_before=0)
    except Stopped:
        progress.update()
        if not is_flying(conversation) and disarm_on_ground(conversation):
            return outcome(Ending.NOT_FLOWN)
        recorder.waypoint_of = lambda _: -1  # the items of the way home are no planned waypoints
        landed = return_home(conversation, plan_return)
        return outcome(Ending.RETURNED if landed else Ending.LEFT_HOLDING)
    progress.update()
    if not progress.all_reached:
        raise VehicleError(
            f"the vehicle landed and disarmed after {progress.reached_count} of {plan.waypoint_count} planned waypoints, "
            f"in {conversation.mode_name}{conversation.complaints}"
        )
    return outcome(Ending.LANDED)


def _refuse_armed(conversation: Conversation) -> None:
    vehicle = conversation.client.vehicle
    if vehicle.armed:
        raise VehicleError(f"vehicle {vehicle.system_id} is armed already, in {conversation.mode_name}; not touched")
