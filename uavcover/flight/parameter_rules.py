"""Autopilot parameters that change our commands or missions, with their required values, read from data.

``uavcover/data/parameters_*.toml`` has a row for each parameter, with the reason of the decision. A rule compares the vehicle's
value with numbers or with facts of the plan. The first case that fits gives the severity of a broken rule.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType
from typing import Any, Final

from mission_io.data_tables import read_document
from mission_io.model.items import Command

Facts = Mapping[str, float]
"""What the plan counts on, by name; in metres, seconds and degrees, and 1 or 0 for yes or no."""

FACTS: Final = frozenset(
    {
        "acceleration", "acceptance", "band_low", "camera_turns", "climb", "cruise", "descent", "farthest", "fence", "fence_on",
        "first", "flight_time", "gimbal", "gimbal_pitch", "heading", "highest", "jerk", "lowest", "own_system",
        "picture_interval", "pictures", "pictures_by_distance", "restart_line", "return_height", "takeoff", "terrain_frames",
        "turn_time", "yaw_rate",
    }
)  # fmt: skip
CATEGORIES: Final = (
    "arming", "camera", "failsafe", "fence", "gimbal", "logging", "mission", "navigation", "return", "yaw",
)  # fmt: skip
_ROUNDING = 0.01
"""Parameters are 32-bit numbers in units of their own: what is less or more than planned by less is rounding."""


class Weight(Enum):
    """Severity of a difference."""

    NONE = "none"
    NOTE = "note"
    WARNING = "warning"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Limit:
    """A row of the table."""

    what: str  # shown to the user
    planned: float | None  # the plan's assumption, in ``unit``; None without one
    vehicle: float  # the vehicle's value, in ``unit``
    unit: str  # of both; empty for a setting's number
    parameter: str  # the vehicle's; empty for what is no parameter
    weight: Weight  # severity of the difference
    matters: str  # why
    # what the plan needs the parameter to be, in the parameter's own unit; None for nothing
    wanted: float | None = None
    doing: str = ""  # what the vehicle does at such a speed, as text; empty for what is none
    shown: bool = True  # whether it stands in the table before arming

    def as_json(self) -> dict[str, Any]:
        """For ``--json``."""
        values = asdict(self)
        del values["doing"], values["shown"]
        return {**values, "weight": self.weight.value}

    @property
    def sentence(self) -> str:
        """The row as a warning."""
        name, unit = f" ({self.parameter})" if self.parameter else "", f" {self.unit}" if self.unit else ""
        if self.doing and self.planned is not None:
            return (
                f"the vehicle {self.doing} at {self.vehicle:g}{unit}{name}, but the plan assumes "
                f"{self.planned:g}{unit}: {self.matters}; plan with the vehicle's speed, or set the parameter"
            )
        planned = "" if self.planned is None else f", planned {self.planned:g}{unit}"
        return f"{self.what}: the vehicle has {self.vehicle:g}{unit}{name}{planned}; {self.matters}"

    @property
    def line(self) -> str:
        """The row as text: planned | vehicle | why it matters."""
        planned = "-" if self.planned is None else f"{self.planned:g} {self.unit}".strip()
        name = f" ({self.parameter})" if self.parameter else ""
        mark = {Weight.WARNING: "! ", Weight.REFUSED: "X "}.get(self.weight, "  ")
        return f"{mark}{self.what} | {planned} | {f'{self.vehicle:g} {self.unit}'.strip()}{name} | {self.matters}"


@dataclass(frozen=True, slots=True)
class RuleCondition:
    """A comparison such as ``FENCE_TYPE has 8``; an operand is a number, or a fact with a number added."""

    subject: str
    operator: str
    operands: tuple[tuple[str, float], ...]

    def numbers(self, facts: Facts) -> list[float] | None:
        """The operands; None when one is a fact that the plan does not have."""
        if any(name and name not in facts for name, _ in self.operands):
            return None
        return [(facts[name] if name else 0.0) + number for name, number in self.operands]

    def holds(self, value: float, facts: Facts) -> bool | None:
        """Whether it holds; None when the plan lacks a compared value."""
        numbers = self.numbers(facts)
        return None if numbers is None else _OPERATORS[self.operator](value, numbers)


def _bits(value: float, numbers: Sequence[float]) -> int:
    return int(value) & int(numbers[0])


_OPERATORS: Final[Mapping[str, Callable[[float, Sequence[float]], bool]]] = MappingProxyType(
    {
        "=": lambda value, numbers: math.isclose(value, numbers[0], rel_tol=1e-6, abs_tol=1e-6),
        "==": lambda value, numbers: math.isclose(value, numbers[0], rel_tol=1e-6, abs_tol=1e-6),
        "!=": lambda value, numbers: not math.isclose(value, numbers[0], rel_tol=1e-6, abs_tol=1e-6),
        ">": lambda value, numbers: value > numbers[0],
        "<": lambda value, numbers: value < numbers[0],
        ">=": lambda value, numbers: value >= numbers[0] - _ROUNDING * abs(numbers[0]),
        "<=": lambda value, numbers: value <= numbers[0] + _ROUNDING * abs(numbers[0]),
        "in": lambda value, numbers: any(math.isclose(value, number, abs_tol=1e-6) for number in numbers),
        "has": lambda value, numbers: _bits(value, numbers) != 0,
        "lacks": lambda value, numbers: _bits(value, numbers) == 0,
    }
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class RuleCase:
    """Weight of a broken rule, under conditions."""

    weight: Weight  # how much
    says: str  # the consequence, as text; a fact in braces is filled in
    when: tuple[RuleCondition, ...] = ()  # what has to be so besides
    # what the plan needs the parameter to be: a fact, a number, a fact with a number added and rounded away from it, or
    # bits to set (``|4``) or to clear (``~4``); empty for nothing
    sets: str = ""

    def wanted(self, value: float, facts: Facts) -> float | None:
        """The value that the plan needs, in our unit; None without one."""
        if not self.sets:
            return None
        if self.sets[0] in "|~":
            bits = int(self.sets[1:])
            return float(int(value) | bits if self.sets[0] == "|" else int(value) & ~bits)
        [(name, number)] = _operands(self.sets)
        if not name:
            return number
        round_away = math.ceil if number > 0.0 else math.floor
        return float(round_away(facts[name] + number)) if number else facts[name]


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A parameter, and the decision about it."""

    names: tuple[tuple[str, float], ...]  # older to newer, each with its units in one of ours
    key: str  # by which conditions name it
    category: str  # one of ``CATEGORIES``
    what: str  # shown to the user
    why: str  # the reason of the decision
    unit: str = ""  # ours; empty for a setting's number
    doing: str = ""  # what the vehicle does at such a speed, as text
    planned: str = ""  # the fact in the table's column; empty for none, and for the rule's own
    default: float = 0.0  # assumed value without a report
    shown: bool = False  # whether the table before arming has it even when it is as planned
    returns: bool = False  # whether it changes the autopilot's own return
    other_version: bool = False  # whether the autopilot's current version does not have it
    applies: tuple[RuleCondition, ...] = ()  # conditions under which the rule applies
    moot: str = ""  # what the table says when it does not count; empty is not to have the row
    rule: RuleCondition | None = None  # required condition; None only to watch it in flight
    worse: tuple[RuleCase, ...] = ()  # consequences of breaking the rule; the first that fits counts
    fine: str = ""  # text of the table if the rule holds
    flown: str = ""  # additional consequence of breaking the rule in flight
    set_by: Command | None = None  # the mission's command whose first parameter the autopilot stores here


@dataclass(frozen=True, slots=True)
class ParameterTable:
    """All rows of an autopilot."""

    rows: tuple[ParameterRow, ...]  # in the table's order
    dismissed: Mapping[str, str]  # beginnings of names that were considered and omitted, with the reason

    def row_of(self, name: str) -> ParameterRow | None:
        """The row of a parameter by any of its names; None for one that has none."""
        return next((row for row in self.rows if any(known == name for known, _ in row.names)), None)

    def judge(self, values: Mapping[str, float], facts: Facts) -> Iterator[Limit]:
        """The rows that the vehicle has, judged.

        Args:
            values: the vehicle's parameters that are known, in their own units.
            facts: what the plan counts on.
        """
        own = {row.key: row.default for row in self.rows} | {
            row.key: values[name] / per_unit for row in self.rows for name, per_unit in row.names if name in values
        }
        facts = {"fence_on": float(own.get("FENCE_ENABLE", 0.0) + own.get("FENCE_AUTOENABLE", 0.0) > 0.0), **facts}
        subjects = dict(facts) | own
        for row in self.rows:
            reading = next(((name, unit) for name, unit in row.names if name in values), None)
            limit = None if reading is None else _judged(row, *reading, subjects, facts)
            if limit is not None:
                yield limit


def _judged(row: ParameterRow, name: str, per_unit: float, subjects: Facts, facts: Facts) -> Limit | None:
    value = subjects[row.key]
    planned = facts.get(row.planned or (row.rule.operands[0][0] if row.rule is not None else ""))

    def limit(weight: Weight, matters: str, wanted: float | None = None) -> Limit:
        planned_value = None if planned is None else round(planned, 2)
        wanted = None if wanted is None else wanted * per_unit
        shown = row.shown or weight is not Weight.NONE
        return Limit(row.what, planned_value, value, row.unit, name, weight, matters, wanted, row.doing, shown)

    if not all(_so(condition, subjects, facts) for condition in row.applies):
        planned = facts.get(row.planned)
        return limit(Weight.NONE, row.moot) if row.moot else None
    holds = None if row.rule is None else row.rule.holds(value, facts)
    if row.rule is not None and holds is None:
        return None
    if row.rule is None or holds:
        return limit(Weight.NONE, row.fine or "as planned")
    case = next((case for case in row.worse if all(_so(condition, subjects, facts) for condition in case.when)), None)
    if case is None:
        return limit(Weight.NONE, row.fine or "as planned")
    matters = case.says.format_map(facts) if case.weight is not Weight.NONE else row.fine or case.says
    return limit(case.weight, matters, case.wanted(value, facts))


def _so(condition: RuleCondition, subjects: Facts, facts: Facts) -> bool:
    return condition.subject in subjects and condition.holds(subjects[condition.subject], facts) is True


@cache
def parameter_table(*, px4: bool) -> ParameterTable:
    """The table of an autopilot; else ArduPilot's.

    Raises:
        ValueError: the data has a key, category, weight, fact, parameter or comparison that there is not.
    """
    file = f"parameters_{'px4' if px4 else 'ardupilot'}.toml"
    return read_table(read_document(f"uavcover/data/{file}"), file)


def read_table(document: Mapping[str, Any], file: str) -> ParameterTable:
    """A table from TOML; errors as ``parameter_table``."""
    rows = tuple(_row(table, f"{file}: {table.get('names', table)}") for table in document["row"])
    names = [name for row in rows for name, _ in row.names]
    keys = {row.key for row in rows}
    for row in rows:
        where = f"{file}: {row.names[0][0]}"
        _require(row.category in CATEGORIES, where, f"category {row.category!r} is not one of {', '.join(CATEGORIES)}")
        _require(all(names.count(name) == 1 for name, _ in row.names), where, "this name appears in two rows")
        _require(bool(row.worse) is (row.rule is not None), where, "must have both rule and worse, or neither")
        used = [*row.applies, *(condition for case in row.worse for condition in case.when)]
        used += [] if row.rule is None else [row.rule]
        for condition in used:
            _require(condition.subject in keys | FACTS, where, f"{condition.subject} is neither a key nor a fact")
            _require(condition.operator in _OPERATORS, where, f"{condition.operator!r} is not a comparison operator")
            _require(all(name in FACTS | {""} for name, _ in condition.operands), where, f"unknown fact in {condition}")
        _require(row.planned in FACTS | {""}, where, f"{row.planned} is not a fact")
        for case in row.worse:
            _require(case.says.format_map(dict.fromkeys(FACTS, 1.0)) != "", where, "the sentence is empty")
            case.wanted(0.0, dict.fromkeys(FACTS, 1.0))
    dismissed = {prefix: group["why"] for group in document["dismissed"] for prefix in group["prefixes"]}
    return ParameterTable(rows, MappingProxyType(dismissed))


_ROW_KEYS = frozenset(
    {
        "names", "key", "category", "what", "why", "unit", "doing", "planned", "default", "shown", "returns", "other_version",
        "if", "moot", "rule", "worse", "fine", "flown", "set_by",
    }
)  # fmt: skip
_PLAIN = ("category", "what", "why", "unit", "doing", "planned", "default", "shown", "returns", "other_version")


def _row(table: Mapping[str, Any], where: str) -> ParameterRow:
    unknown = set(table) - _ROW_KEYS
    _require(not unknown, where, f"unknown key {', '.join(sorted(unknown))}")
    _require(
        {"names", "category", "what", "why"} <= set(table), where, "the keys names, category, what and why are required"
    )
    names = tuple((name, float(unit or 1.0)) for name, _, unit in (text.partition("/") for text in table["names"]))
    key = table.get("key", names[0][0])
    rule = _condition(f"{key} {table['rule']}", where) if "rule" in table else None
    worse = tuple(
        RuleCase(
            Weight(case["weight"]), case["says"], tuple(_condition(text, where) for text in case.get("when", ())),
            str(case.get("sets", "")),
        )
        for case in table.get("worse", ())
    )  # fmt: skip
    applies = tuple(_condition(text, where) for text in table.get("if", ()))
    set_by = Command[table["set_by"]] if "set_by" in table else None
    rest = {name: table[name] for name in (*_PLAIN, "moot", "fine", "flown") if name in table}
    return ParameterRow(names=names, key=key, rule=rule, worse=worse, applies=applies, set_by=set_by, **rest)


def _condition(text: str, where: str) -> RuleCondition:
    parts = text.split()
    _require(len(parts) >= 3, where, f"{text!r} is not a comparison")
    return RuleCondition(parts[0], parts[1], tuple(operand for part in parts[2:] for operand in _operands(part)))


def _operands(text: str) -> list[tuple[str, float]]:
    found = re.fullmatch(r"([a-z]\w*)?([+-]?[\d.]+)?", text)
    if found is None or not text:
        raise ValueError(f"{text!r} is neither a number nor a fact")
    return [(found[1] or "", float(found[2] or 0.0))]


def _require(so: bool, where: str, what: str) -> None:
    if not so:
        raise ValueError(f"{where}: {what}")
