"""Events during a flight, and its ending: one name for each ending, good or bad, with the incidents before it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

from uavcover.errors import VehicleError


class EventKind(Enum):
    """Subject of an event."""

    STAGE = "the flight continues with its next stage"
    WAYPOINT = "the vehicle flies to the next planned waypoint"
    TEXT = "a message from the vehicle"
    WARNING = "a problem that does not end the flight"
    STOP = "the user wants to end the flight"


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """Something that happened."""

    kind: EventKind  # what it is about
    text: str  # one line for people
    time_s: float | None = None  # vehicle time; None before the vehicle sent its time
    waypoint: int | None = None  # number of the planned waypoint that is flown to, for progress; None for other events
    alarm: bool = False  # whether something is wrong now, so that it should be heard too
    # rows of the table of limits that follows as lines, as ``--json`` has them; empty for other events
    limits: tuple[Mapping[str, Any], ...] = ()


class Ending(Enum):
    """Endings of a flight; the names are those of ``run.json`` and ``--json``, in small letters."""

    LANDED = "mission completed, landed and disarmed"
    RETURNED = "stopped by the user, returned along checked legs, landed and disarmed"
    LEFT_HOLDING = "stopped by the user; the vehicle holds its position, armed and in the air"
    NOT_FLOWN = "stopped by the user before it left the ground; disarmed"
    RESERVE_KEPT = "returned early along checked legs to keep the battery reserve, landed and disarmed"

    NOT_ARMED = "not armed: the vehicle does not match the plan"
    NOT_READY = "not armed: the vehicle did not become ready"
    ARMING_REFUSED = "the vehicle refused to arm"
    NOT_STARTED = "the vehicle did not take off"

    LINK_LOST = "the link to the vehicle was lost"
    HEARTBEAT_LOST = "the autopilot's heartbeat was lost, although other messages arrived"
    POSITION_LOST = "the vehicle stopped reporting its position"
    GPS_LOST = "the vehicle lost its satellite fix or its position estimate"
    BATTERY_FAILSAFE = "the battery was low, and the vehicle took its failsafe action"
    BATTERY_LOW = "the battery was low"
    WIND_ABOVE_LIMITS = "the wind was above the vehicle's limits"
    OFF_ROUTE = "the vehicle left the planned route, although it has the planned mission"
    FENCE_BREACHED = "the vehicle left its fence"
    BAND_LEFT = "the vehicle left the height band of its route"
    GROUND_UNKNOWN = "the vehicle flew over ground without data"
    RADIO_LOST = "the pilot's radio was lost, and the vehicle took its failsafe action"
    FAILSAFE = "the vehicle took another failsafe"
    PILOT_TOOK_OVER = "a pilot or another ground station changed the flight mode"
    TAKEN_OVER = "the vehicle left its mission for an unknown reason"
    STATE_UNKNOWN = "the vehicle's mode or state was not known"
    HOLD_LOST = "the vehicle did not hold its position"
    UNSAFE_LINE = "the straight line back to the route was not clear"
    LATE = "the vehicle was later than planned"
    RESERVE_USED = "the flight used the reserve of its battery"
    PHOTOS_MISSING = "the camera reported fewer photos than planned"
    FALLING = "the vehicle fell"
    MISSION_CHANGED = "another station changed the mission, or the current item"
    HOME_MOVED = "another station moved the vehicle's home, or the origin of its heights"
    SETTINGS_CHANGED = "another station changed a parameter that the mission depends on"
    FENCE_CHANGED = "another station changed or disabled the vehicle's fence"
    RALLY_CHANGED = "another station changed the vehicle's rally points"
    RESTARTED = "the vehicle's autopilot restarted"
    STUCK = "the vehicle made no progress"
    CRASHED = "the vehicle crashed: it reported a crash, or it was disarmed in the air and fell"
    ENDED_EARLY = "the vehicle landed before the last planned waypoint"
    STAYED_ARMED = "the vehicle landed and did not disarm"
    FAILED = "the vehicle did not follow its commands"

    @property
    def key(self) -> str:
        """Its name in documents."""
        return self.name.lower()

    @property
    def good(self) -> bool:
        """Whether the flight went as it was planned, or as the user wished."""
        return self in (Ending.LANDED, Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN, Ending.RESERVE_KEPT)


@dataclass(frozen=True, slots=True)
class Incident:
    """Something that went wrong in flight."""

    kind: Ending  # what, by the name of the ending that it leads to when it lasts
    text: str  # the event's text
    begin_s: float | None  # vehicle time; None before the vehicle sent its time
    end_s: float | None = None  # when it was over; None when it lasted to the end
    evidence: tuple[str, ...] = ()  # what it is concluded from, each with its time


@dataclass(frozen=True, slots=True)
class FlightOutcome:
    """Outcome of a flight."""

    ending: Ending  # how
    waypoints_reached: int  # how many planned waypoints were reached, one after the other
    sample_count: int  # how many samples were recorded
    duration_s: float  # vehicle time from the first sample to the last
    simulated_by: str | None  # what simulates the vehicle; None for one that may be real
    incidents: tuple[Incident, ...] = ()  # what went wrong, also what was ridden out
    vehicle_now: str = ""  # what the vehicle did when it was heard last, for people
    # the table of what the plan counts on and what the vehicle was set to; empty for a flight that had none
    limits: tuple[dict[str, Any], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """For ``run.json`` and ``--json``."""
        return {
            "ending": self.ending.key,
            "waypoints_reached": self.waypoints_reached,
            "samples": self.sample_count,
            "duration_s": self.duration_s,
            "simulated_by": self.simulated_by,
            "vehicle_now": self.vehicle_now,
            "incidents": [{**asdict(incident), "kind": incident.kind.key} for incident in self.incidents],
            **({"limits": list(self.limits)} if self.limits else {}),
        }


class FlightFaultError(VehicleError):
    """Something that ends following the vehicle.

    Attributes:
        ending: the name of it.
    """

    def __init__(self, ending: Ending, text: str) -> None:
        self.ending = ending
        super().__init__(text)


class FlightFailedError(VehicleError):
    """A flight that did not end as it should.

    Attributes:
        outcome: how it ended.
    """

    def __init__(self, text: str, outcome: FlightOutcome) -> None:
        self.outcome = outcome
        super().__init__(text)

    def details(self) -> dict[str, Any]:
        """The outcome, for programs."""
        return self.outcome.as_json()
