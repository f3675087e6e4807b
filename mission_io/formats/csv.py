"""CSV writer: every item of a mission, one row each, with units in the column names."""

import math

from mission_io.items import Mission

HEADER = "item,command,frame,param1,param2,param3,param4,lat_deg,lon_deg,alt_m,alt_datum,autocontinue"


def write_mission(mission: Mission) -> str:
    """All items, numbered from 1, with home as row 0 when it is known; numbers unrounded, a missing value empty.

    ``alt_datum`` says what ``alt_m`` is measured from: AMSL, ABOVE_HOME, ABOVE_TERRAIN, or COMMAND for none.
    """
    lines = [HEADER]
    if mission.home is not None:
        home = mission.home
        place = ",".join(_text(value) for value in (home.lat_deg, home.lon_deg, home.alt_amsl_m))
        lines.append(f"0,16,0,0.0,0.0,0.0,0.0,{place},AMSL,1")
    for number, item in enumerate(mission.items, start=1):
        values = ",".join(_text(value) for _, value in item.values())
        lines.append(
            f"{number},{int(item.command)},{int(item.frame)},{values},{item.frame.name},{int(item.autocontinue)}"
        )
    return "\n".join(lines) + "\n"


def _text(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))
