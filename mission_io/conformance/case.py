"""A case as data: its questions, the guide's rule for it, its outcome, and the times of all cases."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any, Final, Generic, TypeVar

from mission_io.client.transfer_outcome import list_name
from mission_io.data_tables import data_table
from mission_io.errors import MissionIoError
from mission_io.model.items import (
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    MissionItem,
    MissionType,
    RallyPoints,
    items_from_fence,
    items_from_rally,
    waypoint,
)
from mission_io.wire import messages as m
from mission_io.wire.messages import degrees_on_wire

# Times and numbers of the cases; ``data/conformance.toml`` explains each.


@dataclass(frozen=True, slots=True, kw_only=True)
class _Probe:
    other_system: int
    absent_system: int
    answer_s: float
    tries: int
    idle_s: float
    longest_rest_s: float
    unmeasured_s: float
    longest_late_s: float
    same_deg: float
    same_m: float
    current_s: float
    new_items: int
    few_items: int
    gives_up_s: float
    slow_s: float
    listed_items: int
    free_s: float
    strange_type: int
    stops_s: float
    unknown_frame: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Station:
    resend_s: float
    item_resend_s: float
    crossing_s: float
    quiet_s: float
    longest_s: float
    tick_s: float


PROBE = data_table(_Probe, "mission_io/data/conformance.toml", "probe")
STATION = data_table(_Station, "mission_io/data/conformance.toml", "station")


REQUESTS: Final = (m.MissionRequest, m.MissionRequestInt)
ITEMS: Final = (m.MissionItemInt, m.MissionItemFloat)
PROTOCOL: Final = (m.MissionCount, *REQUESTS, *ITEMS, m.MissionAck)
"""Messages of a vehicle in the mission protocol."""

# The sections of the MAVLink mission guide that the cases quote by name, with their addresses.

GUIDE: Final = "https://mavlink.io/en/services/mission.html"


class Section(Enum):
    """A section of the guide; the value is its heading."""

    _value_: str
    url: str

    TYPES = "Mission Types", "#mission_types"
    ITEMS = "Mission Items (MAVLink Commands)", "#mavlink_commands"
    MESSAGES = "Message/Enum Summary", "#message-enum-summary"
    DEPRECATED = "Deprecated Types: MISSION_ITEM", "#command_message_type"
    FRAMES = "Frames & Positional Information", "#frames-positional-information"
    CHANGES = "Detecting Mission/Plan Changes", "#detecting-mission-plan-changes"
    UPLOAD = "Upload a Mission to the Vehicle", "#uploading_mission"
    DOWNLOAD = "Download a Mission from the Vehicle", "#download_mission"
    CURRENT = "Set Current Mission Item", "#current_mission_item"
    PROGRESS = "Monitor Mission Progress", "#monitor_progress"
    CLEAR = "Clear Missions", "#clear_mission"
    CANCEL = "Canceling Operations", "#cancel"
    TIMEOUTS = "Timeouts and Retries", "#timeout"
    ERRORS = "Errors/Completion", "#errors"
    ROUTING = "MAVLink Routing", "https://mavlink.io/en/guide/routing.html"
    """Another page: the recipient of a message."""

    def __init__(self, heading: str, address: str) -> None:
        self._value_ = heading
        self.url = address if address.startswith("https:") else GUIDE + address


# The lists that the cases send: asymmetric positions, which reveal every mix-up, and whole metres.

LIST_NAMES: Final = {t: list_name(t) for t in MissionType}


def sample(mission_type: MissionType, count: int, *, first: int = 0) -> tuple[MissionItem, ...]:
    """``count`` items of a list that differ from each other, and from those of another ``first``.

    A fence is one polygon, so it needs three items.
    """
    positions = [
        (degrees_on_wire(47.1 + 1e-4 * (first + i) + 1e-6 * i * i), degrees_on_wire(-8.2 - 2e-4 * (first + i)))
        for i in range(count)
    ]
    if mission_type is MissionType.FENCE:
        return items_from_fence(Fence((FencePolygon(tuple(LatLon(*position) for position in positions)),), ()))
    heights_m = [float(20 + first + i) for i in range(count)]
    if mission_type is MissionType.RALLY:
        points = (FramedPoint(*position, height) for position, height in zip(positions, heights_m, strict=True))
        return items_from_rally(RallyPoints(tuple(points)))
    return tuple(
        waypoint(*position, height, frame=Frame.ABOVE_HOME)
        for position, height in zip(positions, heights_m, strict=True)
    )


def difference(sent: Sequence[MissionItem], held: Sequence[MissionItem], *, home_first: bool = False) -> str:
    """The difference between a list and its read-back, one line; empty without one.

    Args:
        sent: What was sent.
        held: What came back.
        home_first: Whether item 0 is the vehicle's own home, which no upload can set.
    """
    if len(sent) != len(held):
        return f"{len(held)} items in place of {len(sent)}"
    for seq, (a, b) in enumerate(zip(sent, held, strict=True)):
        if seq == 0 and home_first:
            continue
        if a.command != b.command:
            return f"item {seq} is command {b.command} in place of {a.command}"
        if a.frame is not b.frame:
            return f"item {seq} is in frame {b.frame.name} in place of {a.frame.name}"
        if abs(a.lat_deg - b.lat_deg) > PROBE.same_deg or abs(a.lon_deg - b.lon_deg) > PROBE.same_deg:
            return f"item {seq} is at {b.lat_deg:.7f}, {b.lon_deg:.7f} in place of {a.lat_deg:.7f}, {a.lon_deg:.7f}"
        if not abs(a.alt_m - b.alt_m) <= PROBE.same_m:
            return f"item {seq} is at {b.alt_m:g} m in place of {a.alt_m:g} m"
    return ""


SubjectT = TypeVar("SubjectT")


class Outcome(Enum):
    """Outcome of a case."""

    PASS = "pass"
    FAIL = "fail"
    REFUSED = "refused"
    """The other side said no, which it may, so the question stayed open."""
    NOT_SUPPORTED = "not supported"
    """The other side does not have it, or does not show it."""


@dataclass(frozen=True, slots=True)
class CaseResult:
    """The answer to one case."""

    case: str  # its name
    outcome: Outcome  # how it ended
    seen: str  # what the other side did, one line
    took_s: float = 0.0  # seconds from the first message to the verdict


class EndedError(MissionIoError):
    """Ends a case with another verdict than a pass; the message is the observation."""

    verdict = Outcome.FAIL


class FailedError(EndedError):
    """The other side does not follow the guide."""


class RefusedError(EndedError):
    """The other side refused the case."""

    verdict = Outcome.REFUSED


class LackingError(EndedError):
    """The other side lacks the subject of the case."""

    verdict = Outcome.NOT_SUPPORTED


@dataclass(frozen=True, slots=True)
class ProtocolCase(Generic[SubjectT]):
    """One case for a vehicle."""

    name: str  # for ``--case`` and tables
    says: str  # the rule of the guide, in short
    section: Section  # where it says so
    ask: Callable[[SubjectT], str]  # asks it; returns what was seen, or raises an ``EndedError``
    like: tuple[str, ...] = ()  # the tests of MAVSDK's transfer suites that ask the same

    def answered_by(self, subject: SubjectT) -> tuple[Outcome, str]:
        """Ask it; the verdict and the observation."""
        try:
            return Outcome.PASS, self.ask(subject)
        except EndedError as ended:
            return ended.verdict, str(ended)


def for_each_list(
    name: str,
    says: str,
    section: Section,
    ask: Callable[[MissionType, SubjectT], str],
    like: tuple[str, ...] = (),
) -> tuple[ProtocolCase[SubjectT], ...]:
    """The case once for each of the three lists; ``ask`` receives its type."""
    return tuple(
        ProtocolCase(f"{name}-{LIST_NAMES[t].split()[0]}", says, section, partial(ask, t), like) for t in MissionType
    )


def check(condition: object, seen: str) -> None:
    """Continue only if a condition holds. Raises FailedError with ``seen``, the observation."""
    if not condition:
        raise FailedError(seen)


def as_json(result: CaseResult, case: ProtocolCase[Any]) -> dict[str, Any]:
    """A result as plain JSON values."""
    return {
        "case": result.case,
        "result": result.outcome.value,
        "says": case.says,
        "section": case.section.value,
        "url": case.section.url,
        "seen": result.seen,
        "took_s": round(result.took_s, 3),
        "like": list(case.like),
    }
