"""MAVROS: a mission as the request of its service ``mission/push`` (mavros_msgs/srv/WaypointPush), in JSON.

``ros2 service call /mavros/mission/push mavros_msgs/srv/WaypointPush "$(cat mission.json)"`` sends it. The items are those
that the autopilot gets, with home in item 0 where it keeps home there. The fields are those of mavros_msgs/msg/Waypoint.

JSON has no number NaN, which means "the vehicle's own" in a parameter. Where a file without NaN means the same to
ArduPilot, 0 is written, as in ``.waypoints`` files; for others NaN is the text ``"nan"``, which ``ros2 service call`` and
Python's ``float`` take for a number.
"""

import json
import math
from typing import Any

from mission_io.autopilots.autopilot import ARDUPILOT, Autopilot, wire_items
from mission_io.errors import FormatError
from mission_io.formats.text import place_problem
from mission_io.formats.wpl import without_free_values
from mission_io.model.items import Mission, MissionItem


def write_mission(mission: Mission, *, autopilot: Autopilot = ARDUPILOT) -> str:
    """Write a mission for MAVROS.

    Raises:
        FormatError: the mission has no home although the autopilot keeps it in item 0, or a number that is not finite.
    """
    if autopilot.home_in_item_0 and mission.home is None:
        raise FormatError("the mission has no home", where="item 0", advice="give the place it starts from")
    items = wire_items(mission, autopilot)
    waypoints = [_waypoint(number, item, autopilot) for number, item in enumerate(items)]
    return json.dumps({"start_index": 0, "waypoints": waypoints}, indent=1, allow_nan=False) + "\n"


def _waypoint(number: int, item: MissionItem, autopilot: Autopilot) -> dict[str, Any]:
    where = f"item {number}"
    if not all(map(math.isfinite, (item.lat_deg, item.lon_deg, item.alt_m))):
        raise FormatError("a coordinate is not finite", where=where, advice="give finite numbers")
    problem = place_problem(item.lat_deg, item.lon_deg) if item.has_position else None
    if problem is not None:
        raise FormatError(problem.what, where=where, advice=problem.advice)
    params = without_free_values(item) if autopilot.mav_autopilot == ARDUPILOT.mav_autopilot else item.params
    if any(map(math.isinf, params)):
        raise FormatError("a parameter is infinite", where=where, advice="give finite numbers")
    values = {f"param{k}": "nan" if math.isnan(value) else float(value) for k, value in enumerate(params, start=1)}
    return {
        "frame": int(item.frame),
        "command": int(item.command),
        "is_current": number == 0,
        "autocontinue": item.autocontinue,
        **values,
        "x_lat": float(item.lat_deg),
        "y_long": float(item.lon_deg),
        "z_alt": float(item.alt_m),
    }
