"""The parameters of the mock vehicle: names, types, units and defaults of its autopilot, and what they control."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from mission_io.model.enums import AutopilotId
from mission_io.wire.messages import ParamValue
from uavcover.mock.behaviour import Settings

_REAL, _INT = 9, 6
"""MAV_PARAM_TYPE numbers: a 32-bit float and a 32-bit integer."""


@dataclass(frozen=True, slots=True)
class MockParameter:
    """One parameter.

    Attributes:
        default: its value unless it is set.
        attribute: the attribute of ``Settings`` that it exposes; empty for a value of its own.
        per_unit: units of the parameter in one of the attribute.
        whole: whether it is an integer.
    """

    default: float = 0.0
    attribute: str = ""
    per_unit: float = 1.0
    whole: bool = False


def _bound(attribute: str, per_unit: float = 1.0) -> MockParameter:
    return MockParameter(0.0, attribute, per_unit)


def _whole(default: float) -> MockParameter:
    return MockParameter(default, whole=True)


PARAMETERS: Mapping[int, Mapping[str, MockParameter]] = MappingProxyType(
    {
        AutopilotId.ARDUPILOT: {
            "WPNAV_SPEED": _bound("cruise_m_s", 100.0),
            "WPNAV_SPEED_UP": _bound("climb_m_s", 100.0),
            "WPNAV_SPEED_DN": _bound("descent_m_s", 100.0),
            "WPNAV_ACCEL": MockParameter(250.0),
            "WPNAV_JERK": MockParameter(1.0),
            "LAND_SPEED": _bound("land_m_s", 100.0),
            "WPNAV_RADIUS": _bound("acceptance_radius_m", 100.0),
            "RTL_ALT": _bound("return_height_m", 100.0),
            "RTL_ALT_FINAL": MockParameter(0.0),  # above home; 0: land
            "RTL_ALT_TYPE": _whole(0),  # 0 above home, 1 above the terrain
            "RTL_CLIMB_MIN": MockParameter(0.0),
            "RTL_CONE_SLOPE": MockParameter(3.0),
            "RTL_LOIT_TIME": MockParameter(5000.0),
            "RTL_SPEED": MockParameter(0.0),  # 0: WPNAV_SPEED
            "SRTL_ACCURACY": MockParameter(2.0),
            "SRTL_POINTS": _whole(300),  # 0: no SmartRTL
            "RALLY_LIMIT_KM": MockParameter(0.3),
            "RALLY_INCL_HOME": _whole(1),
            "BATT_FS_LOW_ACT": _whole(0),  # 0 none, 1 land, 2 return, 3 and 4 SmartRTL
            "BATT_FS_CRT_ACT": _whole(0),
            "BATT_LOW_MAH": MockParameter(0.0),  # 0: no threshold
            "BATT_CRT_MAH": MockParameter(0.0),
            "FENCE_ENABLE": _whole(0),
            "FENCE_ACTION": _whole(1),  # 0 report, 1 return, 2 land, 3 and 5 SmartRTL, 4 brake
            "FENCE_ALT_MAX": MockParameter(100.0),
            "FENCE_ALT_MIN": MockParameter(-10.0),
            "FENCE_MARGIN": MockParameter(2.0),
            "FENCE_RADIUS": MockParameter(300.0),
            "FENCE_TYPE": _whole(7),  # 1 height, 2 circle around home, 4 polygons and circles, 8 least height
            "FS_GCS_ENABLE": _whole(0),  # 0 none, 1 return, 3 and 4 SmartRTL, 5 land
            "FS_GCS_TIMEOUT": MockParameter(5.0),
            "FS_OPTIONS": _whole(16),  # 2: the mission goes on without a ground station
            "FS_EKF_ACTION": _whole(1),  # it always lands; it has no remote control, and no dead reckoning
            "FS_THR_ENABLE": _whole(0),
            "FS_DR_ENABLE": _whole(0),
            "FRAME_CLASS": _whole(1),
            "FRAME_TYPE": _whole(1),
            "MAV_GCS_SYSID": _whole(255),  # whose silence counts
            "MAV_OPTIONS": _whole(0),  # 1 hears no other ground station
            "MIS_RESTART": _whole(0),  # 1 begins the mission anew each time that it enters AUTO
            "SYSID_THISMAV": _whole(1),
            "TERRAIN_ENABLE": _whole(1),
            "TERRAIN_SPACING": _whole(100),
            "WP_YAW_BEHAVIOR": _whole(2),  # 0 never turns, 1 and 2 to the next waypoint, 3 along its course
        },
        AutopilotId.PX4: {
            "MPC_XY_CRUISE": _bound("cruise_m_s"),
            "MPC_Z_V_AUTO_UP": _bound("climb_m_s"),
            "MPC_Z_V_AUTO_DN": _bound("descent_m_s"),
            "MPC_ACC_HOR": MockParameter(3.0),
            "MPC_JERK_AUTO": MockParameter(4.0),
            "MPC_LAND_SPEED": _bound("land_m_s"),
            "NAV_ACC_RAD": _bound("acceptance_radius_m"),
            "RTL_RETURN_ALT": _bound("return_height_m"),
            "RTL_CONE_ANG": _whole(45),
            "RTL_DESCEND_ALT": MockParameter(10.0),  # of multirotors, by rc.mc_defaults
            "RTL_LAND_DELAY": MockParameter(0.0),  # below 0: it waits there
            "RTL_MIN_DIST": MockParameter(10.0),
            "RTL_TYPE": _whole(0),  # 1 and 3: safe points, mission landing; 2 and 4: along the mission
            "BAT_CRIT_THR": MockParameter(0.07),
            "BAT_EMERGEN_THR": MockParameter(0.05),
            "BAT_LOW_THR": MockParameter(0.15),
            "COM_DL_LOSS_T": _whole(10),
            "COM_HOME_EN": _whole(1),
            "COM_FAIL_ACT_T": MockParameter(5.0),  # it holds for this long before it returns or lands
            "COM_DLL_EXCEPT": _whole(0),
            "COM_FLTT_LOW_ACT": _whole(0),  # these four, and NAV_RCL_ACT: it has no such failsafes
            "COM_POS_LOW_ACT": _whole(0),
            "COM_RCL_EXCEPT": _whole(0),
            "COM_WIND_MAX_ACT": _whole(0),
            "NAV_RCL_ACT": _whole(0),
            "COM_LOW_BAT_ACT": _whole(0),  # 0 warn, 2 land, 3 return, land when nearly empty
            "GF_ACTION": _whole(2),  # 0 none, 1 warn, 2 hold, 3 return, 5 land
            "GF_MAX_HOR_DIST": MockParameter(0.0),  # 0: no limit
            "GF_MAX_VER_DIST": MockParameter(0.0),
            "MAV_SYS_ID": _whole(1),
            "MIS_TAKEOFF_ALT": MockParameter(2.5),
            "MPC_YAW_MODE": _whole(
                0
            ),  # 0 and 4 to the waypoint, 1 to home, 2 away from home, 3 along its course, 5 never turns
            "NAV_DLL_ACT": _whole(0),  # 0 none, 1 hold, 2 return, 3 land
            "SYS_AUTOSTART": _whole(10040),
        },
    }
)
"""By MAV_AUTOPILOT number and name. Names and defaults are those of the autopilots; all here have an effect, or say what
ground stations look for when they connect."""


class Parameters:
    """MockParameter values of one vehicle.

    Attributes:
        settings: the settings that some parameters expose.
    """

    def __init__(self, mav_autopilot: int, settings: Settings) -> None:
        self.settings = settings
        self._known = PARAMETERS[mav_autopilot]
        self._names = list(self._known)
        self._bytewise = mav_autopilot == AutopilotId.PX4
        self._values = {name: row.default for name, row in self._known.items() if not row.attribute}

    def __getitem__(self, name: str) -> float:
        """The value of a parameter in its own unit."""
        row = self._known[name]
        if row.attribute:
            return float(getattr(self.settings, row.attribute)) * row.per_unit
        return self._values[name]

    def name_of(self, name: str, index: int) -> str | None:
        """Name of the requested parameter, by index or else by name; None for one that does not exist."""
        if 0 <= index < len(self._names):
            return self._names[index]
        return name if name in self._known else None

    def message(self, name: str) -> ParamValue:
        """The PARAM_VALUE of a parameter: PX4 sends the bits of an integer, ArduPilot its value."""
        row, value = self._known[name], self[name]
        if row.whole and self._bytewise:
            value = float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
        return ParamValue(name, value, _INT if row.whole else _REAL, len(self._names), self._names.index(name))

    def messages(self) -> list[ParamValue]:
        """All of them, in order."""
        return [self.message(name) for name in self._names]

    def set(self, name: str, wire_value: float) -> None:
        """Set a parameter from its wire value; an invalid value changes nothing, as on real vehicles."""
        row = self._known[name]
        value = wire_value
        if row.whole and self._bytewise:
            value = float(struct.unpack("<i", struct.pack("<f", wire_value))[0])
        self.put(name, value)

    def put(self, name: str, value: float) -> None:
        """Set a parameter to a number in its own unit; an invalid value changes nothing."""
        row = self._known[name]
        if not row.attribute:
            self._values[name] = float(round(value)) if row.whole else value
            return
        try:
            changed: dict[str, Any] = {row.attribute: value / row.per_unit}
            self.settings = replace(self.settings, **changed)
        except ValueError:
            return
