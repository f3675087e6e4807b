"""Asks a vehicle case after case, and gives it back what it held."""

from collections.abc import Callable, Sequence

from mission_io.conformance.case import CaseResult, Outcome, ProtocolCase
from mission_io.conformance.keeping import keep, put_back
from mission_io.conformance.probe import Probe
from mission_io.errors import MisuseError

Tell = Callable[[str], None]


def ask_vehicle(
    probe: Probe,
    cases: Sequence[ProtocolCase[Probe]],
    *,
    tell: Tell,
    answered: Callable[[CaseResult], None] | None = None,
) -> list[CaseResult]:
    """Ask the cases; a vehicle that was found, disarmed, and whose lists may be overwritten.

    Its lists are read before the first case and put back after the last one, whatever happens between.

    Args:
        probe: Speaks to it.
        cases: What to ask.
        tell: Called with lines for the user.
        answered: Called with each result.

    Raises:
        MisuseError: the vehicle is armed, or its lists cannot be read or put back.
    """
    _refuse_armed(probe)
    kept = keep(probe.client)
    if kept.copy is not None:
        tell(f"the vehicle's lists are kept, also in {kept.copy}, until they are put back")
    results: list[CaseResult] = []
    try:
        for case in cases:
            _refuse_armed(probe)
            result = ask_one(probe, case)
            results.append(result)
            if answered is not None:
                answered(result)
    finally:
        if not probe.vehicle.armed:
            probe.rest()
            tell(put_back(probe.client, kept))
        else:
            where = f"; its items are in {kept.copy}" if kept.copy is not None else ""
            tell(f"the vehicle is armed, so its lists were not put back{where}")
    return results


def ask_one(probe: Probe, case: ProtocolCase[Probe]) -> CaseResult:
    """Ask one case, from an idle vehicle to an idle vehicle."""
    probe.rest()
    began = probe.now()
    verdict, seen = case.answered_by(probe)
    return CaseResult(case.name, verdict, seen, probe.now() - began)


def passed(results: Sequence[CaseResult]) -> bool:
    """Whether nothing failed."""
    return all(result.outcome is not Outcome.FAIL for result in results)


def _refuse_armed(probe: Probe) -> None:
    if probe.vehicle.armed:
        raise MisuseError(f"vehicle {probe.vehicle.system_id} is armed; disarm it, this overwrites its mission")
