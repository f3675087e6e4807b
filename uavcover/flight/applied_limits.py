"""Reports the table of limits before arming, sets the parameters that the plan needs, and restores them afterwards.

Parameters are set only if the user wants that. They are read and written as plain numbers in their own units; PX4 transmits the
bits of its integers as if they were floats.
"""

from collections.abc import Collection, Iterable, Mapping

from mission_io.errors import MissionIoError, VehicleSilentError
from mission_io.model.enums import AutopilotId
from mission_io.model.plain_text import counted
from mission_io.protocol.parameter_values import float_of_value, is_whole, value_of_float
from mission_io.wire import messages as m
from mission_io.wire.messages import ParamRequestRead, ParamValue
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.limit_table import Limit, Weight, limit_table, parameter_groups
from uavcover.flight.precautions import Precautions
from uavcover.flight.session import Session
from uavcover.flight.tuning import PREPARATION
from uavcover.missions.failsafes import failsafe_parameter_groups
from uavcover.missions.return_advice import OwnReturns, ReturnAdvice
from uavcover.model.outcome import Ending, EventKind, FlightFaultError
from uavcover.model.vehicle import AutopilotName


def read_parameters(session: Session, groups: Iterable[Collection[str]]) -> dict[str, ParamValue]:
    """Ask for parameters; of each group of names for the same thing one answer is enough.

    A vehicle is silent about a parameter that it does not have, so a missing answer may also be lost: the parameter is
    requested again, and
    more often where a second question has found something. A few are asked for at once, since ArduPilot keeps 20 questions.
    """
    found = dict[str, ParamValue]()
    wanted = [tuple(names) for names in groups]
    quiet_s, found_at_once = PREPARATION.first_limit_answer_s, 0
    for number in range(PREPARATION.limit_rounds):
        left = [names for names in wanted if found.keys().isdisjoint(names)]
        found_at_once = len(found) if number == 1 else found_at_once
        if number > 1 and len(found) == found_at_once:
            break
        for first in range(0, len(left), PREPARATION.limits_at_once):
            quiet_s = _ask(session, left[first : first + PREPARATION.limits_at_once], found, quiet_s)
    asked = {
        name for names in wanted for name in names
    }  # ArduPilot also broadcasts parameters that it counts by itself
    return {name: value for name, value in found.items() if name in asked}


def _ask(session: Session, groups: Collection[Collection[str]], found: dict[str, ParamValue], quiet_s: float) -> float:
    """Ask once, and listen until everything is answered or the link is quiet; returns the next waiting time."""
    client = session.client
    to, began_s = client.vehicle, client.clock.now()
    for name in (name for names in groups for name in names):
        client.send(ParamRequestRead(*to.address, name))
    until_s, longest_s = began_s + quiet_s, began_s + PREPARATION.limit_answer_s
    while any(found.keys().isdisjoint(names) for names in groups) and client.clock.now() < min(until_s, longest_s):
        for received in client.poll(0.1):
            ours = received.sender == to.address
            if ours and isinstance(received.message, ParamValue):
                found[received.message.name] = received.message
                now = client.clock.now()
                quiet_s = max(PREPARATION.least_quiet_s, PREPARATION.quiet_answers * (now - began_s))
                until_s = now + quiet_s
    return quiet_s


def numbers(values: Mapping[str, ParamValue], *, px4: bool) -> dict[str, float]:
    """The values in their own units."""
    return {name: float(value_of_float(value.value, value.param_type, bytewise=px4)) for name, value in values.items()}


def set_parameter(session: Session, name: str, number: float) -> None:
    """Set a parameter of any type to a number in its own unit, and verify the value.

    Raises:
        VehicleSilentError: it does not exist, or the vehicle does not answer.
        mission_io.errors.MisuseError: the vehicle limits or refuses it.
    """
    client = session.client
    known = read_parameters(session, [[name]]).get(name)
    if known is None:
        raise VehicleSilentError(f"the vehicle did not report the parameter {name}")
    value = round(number) if is_whole(known.param_type) else number
    wire = float_of_value(value, known.param_type, bytewise=_is_px4(session), name=name)
    client.set_parameter(name, wire, param_type=known.param_type, timeout_s=PREPARATION.limit_answer_s)


def _is_px4(session: Session) -> bool:
    return session.client.vehicle.mav_autopilot == AutopilotId.PX4


class AppliedLimits:
    """The limits of one flight, and what of the vehicle's parameters was changed for it.

    Args:
        session: with the vehicle.
        precautions: whether to change anything, whom to ask, and where old values are kept.

    Attributes:
        rows: the table as it was reported last; rows that are as planned and not ``shown`` are left out.
        values: the vehicle's parameters of the table, in their own units, as they were read last.
    """

    def __init__(self, session: Session, precautions: Precautions) -> None:
        self._session, self._precautions = session, precautions
        self._before: dict[str, float] = {}
        self.rows: tuple[Limit, ...] = ()
        self.values: dict[str, float] = {}

    def put_back_older(self) -> None:
        """Put back what a flight that was killed has left changed."""
        if self._precautions.left_changed:
            self._before = dict(self._precautions.left_changed)
            self._session.tell(
                EventKind.STAGE, "an earlier flight left changed parameters on the vehicle; restoring them"
            )
            self.put_back()

    def check(self, plan: FlightPlan) -> None:
        """Tell the table, and change what the plan needs if the user agrees.

        Raises:
            FlightFaultError: the vehicle would not fly the plan to its end.
        """
        self._read(plan)
        changes = {row.parameter: row for row in self.rows if row.wanted is not None}
        if self._precautions.apply_limits and changes:
            self._apply(changes)
            self._read(plan)
        for row in self.rows:
            if row.weight is Weight.WARNING:
                self._session.tell(EventKind.WARNING, row.sentence)
        refused = next((row for row in self.rows if row.weight is Weight.REFUSED), None)
        if refused is not None:
            advice = "plan a shorter flight" if not refused.parameter else "set the parameter"
            advice += ", or add --apply-limits" if refused.wanted is not None else ""
            raise FlightFaultError(Ending.NOT_ARMED, f"{refused.sentence}; the vehicle was not armed: {advice}")

    def look(self, plan: FlightPlan) -> None:
        """Tell the table of a vehicle in the air: what would have kept it on the ground is an alarm."""
        self._read(plan)
        for row in self.rows:
            if row.weight in (Weight.WARNING, Weight.REFUSED):
                self._session.tell(EventKind.WARNING, row.sentence, alarm=row.weight is Weight.REFUSED)

    def put_back(self) -> None:
        """Put the old values back; what cannot be is reported, and stays kept for the next time."""
        session = self._session
        if not self._before:
            return
        vehicle = session.client.vehicle
        left: dict[str, float] = {}
        why = ""
        for name, number in self._before.items():
            if vehicle.armed and session.monitor.on_ground is not True:
                left[name], why = number, "the vehicle is in the air and requires them for the remaining flight"
                continue
            try:
                set_parameter(session, name, number)
            except MissionIoError as error:
                left[name], why = number, str(error)
        self._before = left
        self._precautions.keep(left)
        if left:
            text = ", ".join(f"{name} was {number:g}" for name, number in left.items())
            session.tell(
                EventKind.WARNING, f"some parameters on the vehicle remain changed ({why}): {text}", alarm=True
            )
        else:
            session.tell(EventKind.STAGE, "restored the vehicle's previous parameters")

    def _read(self, plan: FlightPlan) -> None:
        session = self._session
        px4 = _is_px4(session)
        self.values = numbers(read_parameters(session, parameter_groups(px4=px4)), px4=px4)
        home = session.monitor.latest(m.HomePosition)
        self.rows = tuple(
            row
            for row in limit_table(
                self.values, plan, px4=px4,
                home_alt_amsl_m=None if home is None else home.alt_amsl_m, own_system=session.client.local.system_id,
            )
            if row.shown
        )  # fmt: skip
        if plan.needs is not None:
            session.tell_limits("limits: planned | on the vehicle | effect", self.rows)

    def _apply(self, changes: Mapping[str, Limit]) -> None:
        session = self._session
        px4 = _is_px4(session)
        old = numbers(read_parameters(session, [[name] for name in changes]), px4=px4)
        wanted = {name: row.wanted for name, row in changes.items() if row.wanted is not None and name in old}
        text = ", ".join(f"{name} {old[name]:g} -> {number:g}" for name, number in wanted.items())
        if not self._precautions.agree(f"parameters to set for this flight and restore afterwards: {text}"):
            session.tell(EventKind.WARNING, f"the parameters were not changed: {text}")
            return
        self._before = {name: old[name] for name in wanted}
        self._precautions.keep(self._before)
        for name, number in wanted.items():
            try:
                set_parameter(session, name, number)
            except MissionIoError as error:
                session.tell(EventKind.WARNING, f"cannot set the parameter {name}: {error}")
        session.tell(EventKind.STAGE, f"parameters set for this flight: {text}")


_MOST_SAID = 6


def tell_own_returns(session: Session, returns: OwnReturns | None) -> ReturnAdvice | None:
    """Read the parameters that failsafes and returns depend on, and warn of every unsafe interval; nothing is refused.

    The advice can be asked for again with other parameters: :func:`tell_returns_by`.
    """
    if returns is None:
        return None
    return tell_returns_by(session, returns, read_return_parameters(session))


def tell_returns_by(session: Session, returns: OwnReturns, parameters: Mapping[str, float]) -> ReturnAdvice:
    """Warn of every unsafe interval of the vehicle's own returns by these parameters, as when they change in flight."""
    advice = returns.advice(parameters)
    for words in return_warnings(advice):
        session.tell(EventKind.WARNING, words)
    return advice


def return_warnings(advice: ReturnAdvice) -> list[str]:
    """Unsafe returns, one line for each interval, then the remedy."""
    found = [f"the autopilot's own return is not safe {words}" for words in advice.sentences[:_MOST_SAID]]
    if len(advice.sentences) > _MOST_SAID:
        more = len(advice.sentences) - _MOST_SAID
        parts = counted(more, "further part of the flight also has", "further parts of the flight also have")
        found.append(f"{parts} an unsafe return")
    if found:
        found.append(advice.remedy)
    return found


def read_return_parameters(session: Session) -> Mapping[str, float]:
    """The vehicle's values of the parameters that its returns depend on, in their own units."""
    px4 = session.client.vehicle.mav_autopilot == AutopilotId.PX4
    name: AutopilotName = "px4" if px4 else "ardupilot"
    return numbers(read_parameters(session, failsafe_parameter_groups(name)), px4=px4)
