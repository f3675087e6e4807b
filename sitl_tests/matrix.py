"""``matrix.toml``: which vehicles there are, what each is asked, and what is expected of it."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, Literal, cast, get_args

from mission_io.errors import MisuseError
from mission_io.model.enums import VehicleKind as MovingKind
from mission_io.model.enums import kind_of, parse_type
from sitl_tests.errors import MatrixError
from uavcover.model.vehicle import AutopilotName

SimulatorKind = Literal["mock", "arducopter", "arduplane", "ardurover", "px4"]
ClientName = Literal["native", "mavsdk"]
WORKS = "works"


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """A row's vehicle.

    Attributes:
        name: what the matrix calls it.
        simulator: what starts it.
        autopilot: whose ways it has.
        speed: vehicle seconds per second.
        mav_type: what it says it is, by its MAV_TYPE number.
    """

    name: str
    simulator: SimulatorKind
    autopilot: AutopilotName
    speed: float
    mav_type: int

    @property
    def is_multirotor(self) -> bool:
        """Whether it can be flown; anything else is only asked what is for foreign types."""
        return kind_of(self.mav_type) is MovingKind.MULTIROTOR


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a capability comes to on a vehicle.

    Attributes:
        outcome: in one word.
        why: the reason where it is not the usual.
        words: texts that must appear in the events of the case, letter by letter.
    """

    outcome: str
    why: str = ""
    words: tuple[str, ...] = ()

    def unsaid(self, events: Sequence[str]) -> list[str]:
        """The words that no event has."""
        return [words for words in self.words if not any(words in event for event in events)]


@dataclass(frozen=True, slots=True)
class Cell:
    """One vehicle, asked one thing, through one client.

    Attributes:
        vehicle: which vehicle.
        capability: name of the capability.
        shows: what it shows, a sentence.
        client: which client speaks to the vehicle.
        expected: what is to come of it.
        long: whether it takes minutes.
        parameters: the vehicle's parameters that are set before it starts.
    """

    vehicle: VehicleKind
    capability: str
    shows: str
    client: ClientName
    expected: Expectation
    long: bool
    parameters: Mapping[str, float]

    @property
    def name(self) -> str:
        """Names the cell, its folder and its test."""
        return f"{self.vehicle.name}-{self.capability}-{self.client}"


def load_matrix() -> tuple[Cell, ...]:
    """All cells of ``matrix.toml``, capability by capability.

    Raises:
        MatrixError: it names a vehicle, simulator, client or key that there is not.
    """
    return tuple(cells_of(tomllib.loads(resources.files("sitl_tests").joinpath("matrix.toml").read_text("utf-8"))))


def cells_of(document: Mapping[str, Any]) -> Iterator[Cell]:
    """The cells of a matrix that was read from TOML; errors as ``load_matrix``."""
    _known_keys("matrix.toml", document, {"vehicles", "capabilities"})
    vehicles = [_vehicle(name, table) for name, table in document["vehicles"].items()]
    for capability, table in document["capabilities"].items():
        where = f"capabilities.{capability}"
        _known_keys(
            where,
            table,
            {"shows", "expected", "words", "otherwise", "clients", "long", "parameters", "foreign", "speeds"},
        )
        otherwise = table.get("otherwise", {})
        _known_keys(f"{where}.otherwise", otherwise, {vehicle.name for vehicle in vehicles})
        _known_keys(f"{where}.parameters", table.get("parameters", {}), set(get_args(AutopilotName)))
        speeds = table.get("speeds", {})
        _known_keys(f"{where}.speeds", speeds, {vehicle.name for vehicle in vehicles})
        _known_keys(f"{where}.clients", dict.fromkeys(table.get("clients", [])), set(get_args(ClientName)))
        usual = Expectation(table.get("expected", WORKS), words=tuple(table.get("words", ())))
        for client in table.get("clients", ["native"]):
            for vehicle in vehicles:
                if vehicle.is_multirotor is table.get("foreign", False):
                    continue
                other = otherwise.get(vehicle.name)
                if other is not None:
                    _known_keys(f"{where}.otherwise.{vehicle.name}", other, {"outcome", "why", "words"})
                yield Cell(
                    vehicle=replace(vehicle, speed=speeds.get(vehicle.name, vehicle.speed)),
                    capability=capability,
                    shows=table["shows"],
                    client=cast(ClientName, client),
                    expected=usual if other is None else _other(other, usual),
                    long=table.get("long", False),
                    parameters=table.get("parameters", {}).get(vehicle.autopilot, {}),
                )


def _other(table: Mapping[str, Any], usual: Expectation) -> Expectation:
    """The expectation of one vehicle; it has words of its own where its outcome is another, and else the usual ones."""
    same = table["outcome"] == usual.outcome
    return Expectation(table["outcome"], table["why"], tuple(table.get("words", usual.words if same else ())))


def _vehicle(name: str, table: Mapping[str, Any]) -> VehicleKind:
    where = f"vehicles.{name}"
    _known_keys(where, table, {"simulator", "autopilot", "speed", "type"})
    _known_keys(f"{where}.simulator", {table["simulator"]: None}, set(get_args(SimulatorKind)))
    _known_keys(f"{where}.autopilot", {table["autopilot"]: None}, set(get_args(AutopilotName)))
    try:
        mav_type = parse_type(table.get("type", "quadrotor"))
    except MisuseError as error:
        raise MatrixError(f"{where}.type: {error}") from None
    return VehicleKind(name, table["simulator"], table["autopilot"], float(table["speed"]), mav_type)


def _known_keys(where: str, table: Mapping[str, Any], known: set[str]) -> None:
    for key in table:
        if key not in known:
            raise MatrixError(f"{where}: {key!r} is not one of {', '.join(sorted(known))}")
