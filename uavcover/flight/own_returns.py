"""Tell, before arming, from where the vehicle's own returns are not safe by its real parameters."""

from collections.abc import Mapping

from mission_io.model.enums import AutopilotId
from uavcover.flight.applied_limits import numbers, read_parameters
from uavcover.flight.session import Session
from uavcover.missions.failsafe_parameters import failsafe_parameter_groups
from uavcover.missions.return_advice import OwnReturns, ReturnAdvice
from uavcover.model.outcome import EventKind
from uavcover.model.vehicle import AutopilotName

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
    found = [f"the vehicle's own return is not safe {words}" for words in advice.sentences[:_MOST_SAID]]
    if len(advice.sentences) > _MOST_SAID:
        found.append(f"{len(advice.sentences) - _MOST_SAID} more parts of the flight have an unsafe return")
    if found:
        found.append(advice.remedy)
    return found


def read_return_parameters(session: Session) -> Mapping[str, float]:
    """The vehicle's values of the parameters that its returns depend on, in their own units."""
    px4 = session.client.vehicle.mav_autopilot == AutopilotId.PX4
    name: AutopilotName = "px4" if px4 else "ardupilot"
    return numbers(read_parameters(session, failsafe_parameter_groups(name)), px4=px4)
