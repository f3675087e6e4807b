"""Decisions as data: findings, each with its requirements and its effect, and the one function that combines them.

Verdicts on flights, on foreign missions (``check``) and on photos are made here. Text is written from findings, and never read
back.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

VerdictName = Literal["passed", "failed", "not proved"]
"""Failed: what was observed breaks a limit or misses a requirement. Not proved: nothing does, but something essential was not
observed."""

Holds = Literal["yes", "no", "not proved"]
"""Whether a requirement holds."""

Effect = Literal["fails", "not proved", "noted"]
"""Effect of a finding on its requirements: they fail; they are not proved; none."""

Requirement = Literal[
    "coverage",
    "sure-coverage",
    "overlap",
    "detection",
    "photos",
    "unobserved-fraction",
    "unobserved-gap",
    "ends",
    "transit-observed",
    "height-band",
    "transit-clearance",
    "transit-height",
    "sea-level",
    "fence",
    "obstacles",
    "no-fly-zones",
    "ground-speed",
    "deviation",
    "separation",
    "evidence",
    "mission",
]
"""Requirements; ``evidence``: that the record can be believed; ``mission``: the subject of ``check``."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found."""

    effect: Effect  # what it does to what it concerns
    concerns: tuple[Requirement, ...]  # the requirements; none only where it is noted
    text: str  # one line for people


def fails(concerns: Requirement | tuple[Requirement, ...], text: str) -> Finding:
    """A finding by which requirements do not hold."""
    return Finding("fails", concerns if isinstance(concerns, tuple) else (concerns,), text)


def unproved(concerns: Requirement | tuple[Requirement, ...], text: str) -> Finding:
    """A finding by which nothing proves that requirements hold."""
    return Finding("not proved", concerns if isinstance(concerns, tuple) else (concerns,), text)


def noted(text: str) -> Finding:
    """A finding that decides nothing."""
    return Finding("noted", (), text)


def combined(effects: Iterable[Effect]) -> VerdictName:
    """The verdict: failed when anything fails, else not proved when anything is not proved, else passed.

    >>> combined(["noted", "not proved"]), combined(["not proved", "fails"]), combined([])
    ('not proved', 'failed', 'passed')
    """
    found = set(effects)
    return "failed" if "fails" in found else "not proved" if "not proved" in found else "passed"


def worst(verdicts: Iterable[VerdictName]) -> VerdictName:
    """The verdict on several things together.

    >>> worst(["passed", "not proved"])
    'not proved'
    """
    effects: dict[VerdictName, Effect] = {"failed": "fails", "not proved": "not proved", "passed": "noted"}
    return combined(effects[verdict] for verdict in verdicts)


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and its grounds."""

    findings: tuple[Finding, ...] = ()  # everything that was found

    @property
    def verdict(self) -> VerdictName:
        """Passed, failed or not proved."""
        return combined(finding.effect for finding in self.findings)

    def texts(self, effect: Effect) -> tuple[str, ...]:
        """The findings with one effect, for people."""
        return tuple(finding.text for finding in self.findings if finding.effect == effect)

    def holds(self, *requirements: Requirement) -> Holds:
        """Whether all of these requirements hold."""
        verdict = combined(finding.effect for finding in self.findings if set(requirements) & set(finding.concerns))
        return {"failed": "no", "not proved": "not proved", "passed": "yes"}[verdict]  # type: ignore[return-value]
