"""What one measurement is, and what came of it."""

from dataclasses import dataclass, fields
from typing import Final

from mission_io.autopilots import ARDUPILOT, PX4, Autopilot, stored_item
from mission_io.items import Frame, MissionItem, waypoint
from mission_io.wire import degrees_on_wire

AUTOPILOTS: Final[dict[str, Autopilot]] = {"ardupilot": ARDUPILOT, "px4": PX4}
"""One asks again after 1 s and gives up after 8 s, the other after 250 ms and 5 s."""

CLIENTS: Final = ("simulated", "native", "mavsdk")
"""Ours in simulated time, ours over UDP, MAVSDK's over UDP."""

DIRECTIONS: Final = ("upload", "download")
LOSSES: Final = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4)
ITEMS: Final = 100


@dataclass(frozen=True, slots=True, order=True)
class Trial:
    """One transfer of 100 items to or from a new vehicle, with that share of the datagrams lost each way.

    Attributes:
        client: One of ``CLIENTS``.
        vehicle: One of ``AUTOPILOTS``.
        direction: One of ``DIRECTIONS``.
        delay_s: How long each datagram is under way, in seconds.
        loss: Share of the datagrams lost, each way.
        seed: Of the losses.
    """

    client: str
    vehicle: str
    direction: str
    delay_s: float
    loss: float
    seed: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a trial.

    Attributes:
        claimed: Whether the client says that it worked.
        correct: Whether the list at the receiving end is the one that was sent, whatever the client says.
        time_s: How long the client took, from being asked to its answer.
        error: What it said when it failed.
    """

    trial: Trial
    claimed: bool
    correct: bool
    time_s: float
    error: str = ""

    def row(self) -> dict[str, str]:
        """As a line of a CSV file."""
        trial = {field.name: str(getattr(self.trial, field.name)) for field in fields(Trial)}
        own = {field.name: str(getattr(self, field.name)) for field in fields(Outcome) if field.name != "trial"}
        return {**trial, **own}

    @classmethod
    def of_row(cls, row: dict[str, str]) -> "Outcome":
        """From a line of a CSV file.

        Raises:
            KeyError: a column is missing.
            ValueError: a number is none.
        """
        numbers = float(row["delay_s"]), float(row["loss"]), int(row["seed"])
        trial = Trial(row["client"], row["vehicle"], row["direction"], *numbers)
        return cls(
            trial,
            row["claimed"] == "True",
            row["correct"] == "True",
            float(row["time_s"]),
            row["error"],
        )


COLUMNS: Final = (*(f.name for f in fields(Trial)), *(f.name for f in fields(Outcome) if f.name != "trial"))


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
