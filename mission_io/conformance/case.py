"""A case as data: its questions, the guide's rule for it, and its outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any, Generic, TypeVar

from mission_io.conformance.guide import Section
from mission_io.conformance.samples import LIST_NAMES
from mission_io.errors import MissionIoError
from mission_io.model.items import MissionType

SubjectT = TypeVar("SubjectT")


class Outcome(Enum):
    """Outcome of a case."""

    PASS = "pass"
    FAIL = "fail"
    REFUSED = "refused"
    """The other side said no, which it may, so the question stayed open."""
    NOT_SUPPORTED = "not supported"
    """The other side has no such thing, or does not let it be seen."""


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
    """The other side refused what the case needs."""

    verdict = Outcome.REFUSED


class LackingError(EndedError):
    """The other side does not have what the case is about."""

    verdict = Outcome.NOT_SUPPORTED


@dataclass(frozen=True, slots=True)
class ProtocolCase(Generic[SubjectT]):
    """One question."""

    name: str  # for ``--case`` and tables
    says: str  # what the guide says, in short
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
    """Go on only if a condition holds.

    Raises:
        FailedError: it does not; ``seen`` is what was seen.
    """
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
