"""What is told while a flight goes on."""

from dataclasses import dataclass
from enum import Enum


class EventKind(Enum):
    """What an event is about."""

    STAGE = "the flight goes on to its next stage"
    WAYPOINT = "the vehicle flies to the next planned waypoint"
    TEXT = "the vehicle says something"
    WARNING = "something is not as it should be, and the flight goes on"
    STOP = "the user wants to end the flight"


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """Something that happened.

    Attributes:
        kind: what it is about.
        text: one line for people.
        time_s: vehicle time; None before the vehicle told its time.
        waypoint: number of the planned waypoint that is flown to, for progress; None for other events.
        alarm: whether something is wrong now, so that it should be heard too.
    """

    kind: EventKind
    text: str
    time_s: float | None = None
    waypoint: int | None = None
    alarm: bool = False
