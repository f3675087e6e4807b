"""What the vehicle does by itself when it leaves its fence or hears no ground station any more."""

from mission_io.errors import MissionIoError
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import require
from sitl_tests.flying import require_at_home, take_off, wait_for_waypoint, wait_until_landed
from sitl_tests.missions import fence_around, route_mission
from sitl_tests.relay import Relay
from uavcover.errors import VehicleError
from uavcover.flight.modes import Mode, custom_mode

_FENCE_HALF_WIDTH_M = 60.0
_OUTWARD_M = ((0.0, 30.0), (0.0, 150.0))
_REACTION_S = 120.0


def fence_breach(case: Case) -> Finding:
    """A mission leads out of the fence."""
    home = case.vehicle.home
    with case.station() as station:
        fence = station.client.upload_and_verify(fence_around(home, _FENCE_HALF_WIDTH_M))
        require(fence.passed, "the fence was read back changed")
        try:
            path = take_off(case, station, route_mission(home, _OUTWARD_M))
        except (VehicleError, MissionIoError) as error:
            return Finding("refuses", str(error))
        outcome, mode = _reaction(station)
        wait_until_landed(station)
    farthest_m = max(north for _, north, _ in path.enu_m)
    if outcome == "returns":
        require_at_home(path)
    return Finding(outcome, f"fence at {_FENCE_HALF_WIDTH_M:g} m north, it came to {farthest_m:.0f} m; then {mode}")


def link_loss(case: Case) -> Finding:
    """On the way, nothing from any ground station reaches the vehicle any more; we still hear it."""
    with Relay(case.vehicle.url, seed=case.seed) as relay, case.station(relay.url) as station:
        path = take_off(case, station)
        wait_for_waypoint(station, 1)
        lost_s = station.monitor.time_s or 0.0
        relay.cut_to_vehicle()
        outcome, mode = _reaction(station)
        after_s = (station.monitor.time_s or 0.0) - lost_s
        wait_until_landed(station)
    if outcome == "returns":
        require_at_home(path)
    return Finding(outcome, f"{mode} {after_s:.0f} s after the last heartbeat of a ground station")


def _reaction(station: Station) -> tuple[str, str]:
    """What the vehicle changes to before it has landed, as an outcome and for people."""
    autopilot = station.conversation.autopilot
    named = {Mode.RETURN: "returns", Mode.LAND: "lands", Mode.HOLD: "holds"}
    numbers = {custom_mode(autopilot, mode): outcome for mode, outcome in named.items()}
    station.wait(
        lambda: station.client.vehicle.custom_mode in numbers or not station.client.vehicle.armed,
        within_s=_REACTION_S,
        what="the vehicle neither changes its mode nor lands",
    )
    if not station.client.vehicle.armed:
        return "flies-on", "it flew its mission to the end"
    return numbers[station.client.vehicle.custom_mode], station.conversation.mode_name
