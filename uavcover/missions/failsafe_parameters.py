"""The failsafes that an autopilot's parameters enable, and what a return depends on: ``data/failsafes.toml``."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any, Literal, get_args

from uavcover.errors import UavcoverError
from uavcover.model.vehicle import AutopilotName

Action = Literal[
    "none", "hold", "land", "return", "retrace", "retrace-land", "mission-landing", "hold-land", "terminate"
]
"""``retrace``: back along the flown path, else return (or land); ``mission-landing``: to the mission's landing, else return."""

_SETTING_KEYS, _RULE_KEYS = {"names", "default"}, {"trigger", "parameter", "default", "other", "actions"}
_RULE_OPTIONS = {"continues", "enabled_by"}
_TABLE = "data/failsafes.toml"


@dataclass(frozen=True, slots=True)
class Response:
    """Failsafe response of a vehicle."""

    action: Action  # what it does
    # what makes it do so, for people; "commanded" for a return that the pilot or the ground station asks for
    trigger: str
    parameter: str = ""  # that decides it; empty where it is commanded
    value: int = 0  # of that parameter
    is_assumed: bool = False  # whether the value is the autopilot's default, because the vehicle's is unknown

    def __str__(self) -> str:
        if not self.parameter:
            return self.trigger
        return f"{self.trigger} ({self.parameter} {self.value}{', its default' if self.is_assumed else ''})"


@dataclass(frozen=True, slots=True)
class FailsafeSettings:
    """The parameters of one vehicle, by their meaning."""

    autopilot: AutopilotName  # whose parameters they are
    values: Mapping[str, float]  # by the names of ``settings`` in ``data/failsafes.toml``, in metres, seconds and m/s
    # what it does by itself or when commanded; responses that change nothing are left out
    responses: tuple[Response, ...]
    assumed: tuple[str, ...]  # names of the parameters whose defaults stand in for unknown values

    def __getitem__(self, name: str) -> float:
        """A value by the name of its setting."""
        return self.values[name]


def failsafe_settings(
    autopilot: AutopilotName, parameters: Mapping[str, float], *, known: Mapping[str, float] | None = None
) -> FailsafeSettings:
    """List the failsafe responses of a vehicle.

    Args:
        autopilot: whose parameters they are.
        parameters: names and values as the vehicle has them; may be empty or incomplete.
        known: values of settings that stand in for missing parameters instead of the autopilot's defaults, such as the speeds
            and the return height of a scenario.
    """
    table = _tables()[autopilot]
    values: dict[str, float] = {}
    assumed: list[str] = []
    for name, row in table["settings"].items():
        found = [parameters[one] * scale for one, scale in row["names"].items() if one in parameters]
        if found and math.isfinite(found[-1]):
            values[name] = float(found[-1])
        elif known is not None and name in known:
            values[name] = float(known[name])
        else:
            values[name] = float(row["default"])
            assumed.append(next(iter(row["names"])))
    responses = [Response("return", "commanded")]
    for rule in table["failsafes"]:
        name = rule["parameter"]
        if name not in parameters and name not in assumed:
            assumed.append(name)
        value = round(parameters.get(name, rule["default"]))
        action: Action = rule["actions"].get(str(value), rule["other"])
        needed = rule.get("enabled_by")
        parameter, mask = rule.get("continues", ("", 0))
        goes_on = bool(round(parameters.get(parameter, 0.0)) & mask)
        if action != "none" and not goes_on and not (needed and not parameters.get(needed, 0.0)):
            responses.append(Response(action, rule["trigger"], name, value, name not in parameters))
    return FailsafeSettings(autopilot, MappingProxyType(values), tuple(responses), tuple(assumed))


def failsafe_parameter_groups(autopilot: AutopilotName) -> list[list[str]]:
    """The names to ask a vehicle for; of each group it has one, or none."""
    table = _tables()[autopilot]
    groups = [list(row["names"]) for row in table["settings"].values()]
    singles = {rule["parameter"] for rule in table["failsafes"]}
    singles |= {rule["continues"][0] for rule in table["failsafes"] if "continues" in rule}
    return groups + [[name] for name in sorted(singles)]


@cache
def _tables() -> Mapping[str, Any]:
    text = (resources.files("uavcover") / _TABLE).read_text(encoding="utf-8")
    tables: Mapping[str, Any] = tomllib.loads(text)
    for autopilot, table in tables.items():
        _check(autopilot, table)
    return tables


def _check(autopilot: str, table: Mapping[str, Any]) -> None:
    """Refuse a table that says less, or more, than is understood."""
    for name, row in table["settings"].items():
        if set(row) != _SETTING_KEYS or not row["names"] or not all(scale > 0.0 for scale in row["names"].values()):
            raise UavcoverError(f"{_TABLE}: {autopilot}.settings.{name}: set names, factors above 0 and a default")
    for rule in table["failsafes"]:
        where = f"{_TABLE}: {autopilot} failsafe {rule.get('parameter', '?')}"
        if not (_RULE_KEYS <= set(rule) <= _RULE_KEYS | _RULE_OPTIONS):
            raise UavcoverError(f"{where}: the keys are {', '.join(sorted(_RULE_KEYS | _RULE_OPTIONS))}")
        unknown = {rule["other"], *rule["actions"].values()} - set(get_args(Action))
        if unknown:
            raise UavcoverError(f"{where}: {sorted(unknown)[0]!r} is not an action; use {', '.join(get_args(Action))}")
