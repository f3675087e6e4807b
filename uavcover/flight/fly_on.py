"""Takes control of a vehicle in the air and flies the rest of a plan."""

from collections.abc import Callable
from dataclasses import dataclass

from mission_io.wire import messages as m
from uavcover.errors import UavcoverError
from uavcover.flight.arming import fly_from_item, hold_mode, wire_seq
from uavcover.flight.client import VehicleClient
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.fly import FlightRun, Orders
from uavcover.flight.follow import follow_mission
from uavcover.flight.modes import Mode, custom_mode
from uavcover.flight.monitor import Monitor
from uavcover.flight.readiness import check_home_position, check_telemetry, request_telemetry
from uavcover.flight.return_home import PlanReturn, hold
from uavcover.flight.session import Session, Stopped, TakenOverError
from uavcover.model.outcome import Ending, EventKind, FlightFaultError, FlightOutcome


@dataclass(frozen=True, slots=True)
class Continuation:
    """Continuation of a vehicle in the air."""

    plan: FlightPlan  # what it flies from here
    upload: bool  # whether the mission must be uploaded; otherwise the vehicle holds it already
    first_item: int  # index in ``plan.mission.items`` of the first item to fly to


PlanContinuation = Callable[[float, float, float], Continuation]
"""Plans a checked continuation from latitude, longitude (degrees) and height above sea level (metres)."""


def fly_on(
    client: VehicleClient,  # talks to the vehicle
    monitor: Monitor,  # receives everything that the client receives
    plan_continuation: PlanContinuation,  # plans the checked way on from where the vehicle holds
    orders: Orders,  # what the user wants, and who receives the events
    *,
    plan_return: PlanReturn,  # plans the checked return after a stop
) -> FlightOutcome:
    """Take control of a vehicle in the air and fly the rest of a plan.

    The vehicle is commanded to hold first. A vehicle that is neither in its mission nor holding is left alone: a pilot or a
    failsafe controls it.

    Raises:
        FlightFailedError: as for ``fly``.
    """
    flight = FlightRun(client, monitor, orders)
    return flight.ended(lambda: _from_the_air(flight, plan_continuation, plan_return))


def _from_the_air(flight: FlightRun, plan_continuation: PlanContinuation, plan_return: PlanReturn) -> FlightOutcome:
    session = flight.session
    flight.find(_refuse_taken)
    try:
        request_telemetry(session)
        check_telemetry(session)
        flight.orders.on_begin()
        hold(session, "commanding the vehicle to hold")
        flight.touched = True
        here = session.monitor.latest(m.GlobalPositionInt)
        if here is None:
            raise FlightFaultError(
                Ending.POSITION_LOST, "the vehicle does not report its position; it continues to hold"
            )
        try:
            onward = plan_continuation(here.lat_deg, here.lon_deg, here.alt_amsl_m)
        except UavcoverError as error:
            raise FlightFaultError(
                Ending.FAILED,
                f"no checked route starts at the current position: {error}; the vehicle continues to hold",
            ) from error
        plan = onward.plan
        check_home_position(session, plan)
        flight.limits.look(plan)
        flight.watch_preconditions(plan)
        if onward.upload:
            session.tell(EventKind.STAGE, "uploading the remaining mission")
            client = session.client
            sent = session.steer(
                lambda: client.upload_and_verify(plan.mission, in_flight=True), while_in=[hold_mode(session)]
            )
            if not sent.passed:
                raise FlightFaultError(
                    Ending.FAILED,
                    "the mission read back from the vehicle differs from the remaining mission; the "
                    "vehicle continues to hold",
                )
        if session.stop():
            raise Stopped
        session.monitor.forget(m.MissionCurrent)
        progress = flight.record(plan)
        try:
            fly_from_item(session, wire_seq(session, onward.first_item))
        except TakenOverError as error:
            session.tell(EventKind.WARNING, str(error), alarm=True)  # and follow it to the ground
        session.watch.take_off()
        session.tell(EventKind.STAGE, "continuing the mission")
        follow_mission(session, plan, progress, flight.orders.clearance.must_go_home, flight.preconditions)
    except Stopped as stop:
        return flight.home(plan_return, stop.cause)
    return flight.outcome(Ending.LANDED)


def _refuse_taken(session: Session) -> None:
    """Refuse a vehicle that is neither in its mission nor holding."""
    allowed = {custom_mode(session.autopilot, mode) for mode in (Mode.MISSION, Mode.HOLD, hold_mode(session))}
    if session.client.vehicle.custom_mode not in allowed:
        raise FlightFaultError(
            Ending.NOT_ARMED,
            f"vehicle {session.client.vehicle.system_id} is in the air in {session.mode_name}: a pilot or a failsafe "
            "controls it, so no command was sent; land it or switch it to hold, then use --resume",
        )
