"""Results as lines for people: one row for each case, and a sum."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

from mission_io.conformance.case import CaseResult, Outcome, ProtocolCase

_NAME: Final = 32
_RESULT: Final = 13
HEADING: Final = (
    f"| {'case':<{_NAME}} | {'result':<{_RESULT}} | seen | the guide |\n| {'-' * _NAME} | {'-' * _RESULT} | --- | --- |"
)


def row(result: CaseResult, case: ProtocolCase[Any]) -> str:
    """One row of the table, in Markdown."""
    seen = " ".join(result.seen.replace("|", "/").split())
    return (
        f"| {result.case:<{_NAME}} | {result.outcome.value:<{_RESULT}} | {seen} | {case.section.value}: {case.says} |"
    )


def total(results: Sequence[CaseResult]) -> str:
    """How many ended how."""
    counts = Counter(result.outcome for result in results)
    return f"{len(results)} cases: " + ", ".join(f"{counts[v]} {v.value}" for v in Outcome)
