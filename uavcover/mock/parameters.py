"""The parameters of the mock vehicle: names, types, units and defaults of its autopilot, and what they control."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from mission_io.data_tables import read_document, table_of
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

    def __post_init__(self) -> None:
        if self.attribute and self.attribute not in Settings.__slots__:
            raise ValueError(f"{self.attribute!r} is not one of {', '.join(Settings.__slots__)}")


def _parameters(autopilot: AutopilotId) -> Mapping[str, MockParameter]:
    """Each row is a number, whole if it is written so, or names what of the settings it exposes."""
    name, path = autopilot.name.lower(), "uavcover/data/mock_parameters.toml"
    plain = {"default": 0.0, "attribute": "", "per_unit": 1.0, "whole": False}
    return {
        key: table_of(
            MockParameter,
            plain | (row if isinstance(row, dict) else {"default": row, "whole": isinstance(row, int)}),
            where=f"{path}: {name}.{key}",
        )
        for key, row in read_document(path)[name].items()
    }


PARAMETERS: Mapping[int, Mapping[str, MockParameter]] = MappingProxyType(
    {autopilot: _parameters(autopilot) for autopilot in (AutopilotId.ARDUPILOT, AutopilotId.PX4)}
)
"""By MAV_AUTOPILOT number and name."""


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
