"""Whether the vehicle climbs and descends as fast as the plan counts on; a slower one flies longer than planned."""

from collections.abc import Mapping
from types import MappingProxyType

from mission_io.enums import AutopilotId
from mission_io.errors import VehicleSilentError
from uavcover.flight.conversation import Conversation
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan

_ANSWER_S = 3.0
_SLOWER = 0.99
"""Parameters are 32-bit numbers in units of their own: what is slower by less is rounding."""

_PARAMETERS: Mapping[int, tuple[tuple[str, str, float], ...]] = MappingProxyType(
    {
        AutopilotId.ARDUPILOT: (("climbs", "WPNAV_SPEED_UP", 100.0), ("descends", "WPNAV_SPEED_DN", 100.0)),
        AutopilotId.PX4: (("climbs", "MPC_Z_V_AUTO_UP", 1.0), ("descends", "MPC_Z_V_AUTO_DN", 1.0)),
    }
)
"""What each says, of copters: the vehicle's doing, the parameter, and its units per metre a second."""


def tell_slower_limits(conversation: Conversation, plan: FlightPlan) -> None:
    """Warn of each vertical speed that the vehicle does not fly as fast as the plan counts on.

    A vehicle that does not tell such a parameter is passed over: other kinds of vehicles have none.
    """
    planned = {"climbs": plan.max_climb_m_s, "descends": plan.max_descent_m_s}
    for doing, name, per_m_s in _PARAMETERS.get(conversation.client.vehicle.mav_autopilot, ()):
        wanted_m_s = planned[doing]
        if wanted_m_s is None:
            continue
        try:
            limit_m_s = conversation.client.read_parameter(name, timeout_s=_ANSWER_S).value / per_m_s
        except VehicleSilentError:
            continue
        if limit_m_s < _SLOWER * wanted_m_s:
            conversation.tell(
                EventKind.WARNING,
                f"the vehicle {doing} at {limit_m_s:g} m/s ({name}), the plan counts on {wanted_m_s:g} m/s: the flight takes "
                "longer than planned; plan with the vehicle's speeds, or set the parameter",
            )
