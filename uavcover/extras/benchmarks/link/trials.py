"""A measurement, its outcome, and the tables of all outcomes: one row for each cell of the grid, and as Markdown."""

import math
import statistics
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from typing import Final

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import stored_item
from mission_io.model.items import Frame, MissionItem, waypoint
from mission_io.wire.mission_items import degrees_on_wire

AUTOPILOTS: Final[dict[str, Autopilot]] = {"ardupilot": ARDUPILOT, "px4": PX4}
"""One asks again after 1 s and gives up after 8 s, the other after 250 ms and 5 s."""

CLIENTS: Final = ("simulated", "native", "mavsdk")
"""Ours in simulated time, ours over UDP, MAVSDK's over UDP."""

DIRECTIONS: Final = ("upload", "download")
LOSSES: Final = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4)
ITEMS: Final = 100


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One transfer of a list to or from a new vehicle, with that share of the datagrams lost each way."""

    client: str  # one of ``CLIENTS``
    vehicle: str  # one of ``AUTOPILOTS``
    direction: str  # one of ``DIRECTIONS``
    delay_s: float  # how long each datagram is under way, in seconds
    loss: float  # share of the datagrams lost, each way
    seed: int  # of the losses
    items: int = ITEMS  # how many there are in the list


@dataclass(frozen=True, slots=True)
class TransferOutcome:
    """Outcome of a trial."""

    trial: Trial
    claimed: bool  # whether the client says that it worked
    correct: bool  # whether the list at the receiving end is the one that was sent, independent of the client's claim
    time_s: float  # how long the client took, from being asked to its answer
    error: str = ""  # what it said when it failed

    def row(self) -> dict[str, str]:
        """As a line of a CSV file."""
        trial = {field.name: str(getattr(self.trial, field.name)) for field in fields(Trial)}
        own = {field.name: str(getattr(self, field.name)) for field in fields(TransferOutcome) if field.name != "trial"}
        return {**trial, **own}

    @classmethod
    def of_row(cls, row: dict[str, str]) -> "TransferOutcome":
        """Read a trial from a line of a CSV file.

        Raises:
            KeyError: a column is missing.
            ValueError: a number is none.
        """
        numbers = float(row["delay_s"]), float(row["loss"]), int(row["seed"]), int(row.get("items") or ITEMS)
        trial = Trial(row["client"], row["vehicle"], row["direction"], *numbers)
        return cls(
            trial,
            row["claimed"] == "True",
            row["correct"] == "True",
            float(row["time_s"]),
            row["error"],
        )


COLUMNS: Final = (*(f.name for f in fields(Trial)), *(f.name for f in fields(TransferOutcome) if f.name != "trial"))


def mission_items(count: int = ITEMS) -> tuple[MissionItem, ...]:
    """A mission in which no two items, and no latitude and longitude, are alike."""
    return tuple(
        waypoint(
            degrees_on_wire(46.1 + i * 1e-3),
            degrees_on_wire(-7.2 - i * 2e-3),
            100.0 + i,
            frame=Frame.ABOVE_HOME,
            hold_s=float(i % 7),
        )
        for i in range(count)
    )


def items_on(vehicle: str, count: int = ITEMS) -> tuple[MissionItem, ...]:
    """The same as that autopilot stores it."""
    return tuple(stored_item(item, AUTOPILOTS[vehicle]) for item in mission_items(count))


_NAMES = {"simulated": "ours, simulated", "native": "ours, UDP", "mavsdk": "MAVSDK, UDP"}


@dataclass(frozen=True, slots=True)
class Cell:
    """The trials that differ in their seed only.

    Attributes:
        runs: How many.
        correct: How many worked, and said so.
        wrong_unnoticed: How many said that they worked, and did not.
        median_s, slowest_s: Of those that worked; NaN when none did.
    """

    vehicle: str
    direction: str
    delay_s: float
    loss: float
    client: str
    runs: int
    correct: int
    wrong_unnoticed: int
    median_s: float
    slowest_s: float

    @property
    def share(self) -> float:
        """Share of the runs that worked."""
        return self.correct / self.runs


def cells_of(outcomes: Iterable[TransferOutcome]) -> list[Cell]:
    """Every cell, in the order of the table."""
    groups: dict[tuple[str, str, float, float, str], list[TransferOutcome]] = {}
    for outcome in outcomes:
        trial = outcome.trial
        groups.setdefault((trial.vehicle, trial.direction, trial.delay_s, trial.loss, trial.client), []).append(outcome)
    order = [list(AUTOPILOTS), list(DIRECTIONS), None, None, list(CLIENTS)]
    keys = sorted(groups, key=lambda key: [names.index(k) if names else k for names, k in zip(order, key, strict=True)])  # type: ignore[arg-type]
    return [_cell(key, groups[key]) for key in keys]


def _cell(key: tuple[str, str, float, float, str], outcomes: Collection[TransferOutcome]) -> Cell:
    times = sorted(outcome.time_s for outcome in outcomes if outcome.claimed and outcome.correct)
    return Cell(
        *key,
        runs=len(outcomes),
        correct=len(times),
        wrong_unnoticed=sum(outcome.claimed and not outcome.correct for outcome in outcomes),
        median_s=statistics.median(times) if times else math.nan,
        slowest_s=times[-1] if times else math.nan,
    )


def csv_lines(cells: Iterable[Cell]) -> list[str]:
    """The cells as CSV, numbers unrounded."""
    names = list(Cell.__dataclass_fields__)
    return [",".join(names), *(",".join(str(getattr(cell, name)) for name in names) for cell in cells)]


def markdown(cells: Collection[Cell]) -> str:
    """The cells as a table: a line for each vehicle, direction and loss, the clients side by side."""
    clients = [client for client in CLIENTS if any(cell.client == client for cell in cells)]
    by_key = {(cell.vehicle, cell.direction, cell.delay_s, cell.loss, cell.client): cell for cell in cells}
    head = ["vehicle", "transfer", "delay", "loss", *(f"{_NAMES[c]}: worked | median, slowest" for c in clients)]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * (4 + 2 * len(clients))}"]
    for vehicle, direction, delay_s, loss in dict.fromkeys((c.vehicle, c.direction, c.delay_s, c.loss) for c in cells):
        entries = [_entry(by_key.get((vehicle, direction, delay_s, loss, client))) for client in clients]
        lines.append(f"| {vehicle} | {direction} | {delay_s * 1e3:g} ms | {loss:.0%} | {' | '.join(entries)} |")
    return "\n".join(lines)


def _entry(cell: Cell | None) -> str:
    if cell is None:
        return "- | -"
    wrong = f", {cell.wrong_unnoticed} wrong unnoticed" if cell.wrong_unnoticed else ""
    times = "-" if not cell.correct else f"{_seconds(cell.median_s)}, {_seconds(cell.slowest_s)}"
    return f"{cell.correct}/{cell.runs}{wrong} | {times}"


def _seconds(time_s: float) -> str:
    return f"{time_s * 1e3:.1f} ms" if time_s < 0.1 else f"{time_s:.2f} s"
