"""``python -m mission_io.conformance``: tests a vehicle or a ground station."""

import argparse
import json
import signal
import sys
from collections import Counter
from collections.abc import Sequence
from types import FrameType
from typing import Any, Final, TypeVar

from mission_io.conformance.case import STATION, CaseResult, Outcome, ProtocolCase, as_json
from mission_io.conformance.client_case import ON_REQUEST, ClientCase
from mission_io.conformance.client_cases import CLIENT_CASES
from mission_io.conformance.download_cases import DOWNLOAD_CASES
from mission_io.conformance.fake_vehicle import FakeVehicle
from mission_io.conformance.probe import Probe
from mission_io.conformance.refusal_cases import LIST_CASES, REFUSAL_CASES
from mission_io.conformance.run import ask_vehicle, serve
from mission_io.conformance.upload_cases import UPLOAD_CASES
from mission_io.errors import LinkError, MissionIoError, MisuseError, VehicleSilentError
from mission_io.links.opening import LINK_FORMS, open_link
from mission_io.model.enums import AutopilotId

DONE, SOME_FAIL, BAD_USAGE, LINK_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

_WARNING = (
    "This overwrites the mission, the fence and the rally points of the vehicle at {url}, and restores them afterwards. "
    "Not in flight."
)
CaseT = TypeVar("CaseT", bound=ProtocolCase[Any])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0: passed, 1: a case failed, 2: bad usage, 3: vehicle or link failed."""
    parsed = _parser().parse_args(arguments)
    try:
        if parsed.list:
            return _listed(parsed)
        if parsed.url is None:
            raise MisuseError(f"specify the vehicle's URL: {LINK_FORMS}")
        return _serve(parsed) if parsed.serve else _ask(parsed)
    except (LinkError, VehicleSilentError) as error:
        print(f"error: {error}", file=sys.stderr)
        return LINK_FAILED
    except MissionIoError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_USAGE
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m mission_io.conformance",
        description="Test a vehicle or a ground station against the MAVLink mission protocol.",
    )
    parser.add_argument("url", nargs="?", metavar="URL", help=LINK_FORMS)
    parser.add_argument(
        "--serve", action="store_true", help="act as a vehicle that misbehaves, and judge the ground station"
    )
    parser.add_argument(
        "--case",
        action="append",
        metavar="NAME",
        help="only this case; repeatable; NAME* selects all cases that begin with NAME",
    )
    parser.add_argument("--list", action="store_true", help="list the cases (with --serve: those for ground stations)")
    parser.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, the table on standard error"
    )
    parser.add_argument("--yes", action="store_true", help="overwrite the vehicle's lists without asking")
    parser.add_argument("--system", type=int, metavar="N", help="the vehicle with this system id")
    parser.add_argument(
        "--as", dest="autopilot", choices=("px4", "ardupilot"), default="px4", help="vehicle type that --serve reports"
    )
    parser.add_argument(
        "--quiet",
        type=float,
        default=STATION.quiet_s,
        metavar="S",
        help=f"--serve: silence that ends a case, {STATION.quiet_s:g} s",
    )
    return parser


def _chosen(cases: Sequence[CaseT], names: Sequence[str] | None) -> list[CaseT]:
    if not names:
        return list(cases)
    for name in names:
        if not any(_is_named(case, name) for case in cases):
            raise MisuseError(f"--case: {name!r} is not a case; --list shows them")
    return [case for case in cases if any(_is_named(case, name) for name in names)]


def _is_named(case: ProtocolCase[Any], name: str) -> bool:
    return case.name.startswith(name[:-1]) if name.endswith("*") else case.name == name


def _listed(parsed: argparse.Namespace) -> int:
    cases: Sequence[ProtocolCase[Any]] = CLIENT_CASES if parsed.serve else VEHICLE_CASES
    for case in _chosen(cases, parsed.case):
        what = f" [{case.operation.value}]" if isinstance(case, ClientCase) else ""
        print(f"{case.name:<32} {case.section.value}: {case.says}{what}")
    return DONE


def _finished(
    parsed: argparse.Namespace, results: Sequence[CaseResult], cases: Sequence[ProtocolCase[Any]], subject: str
) -> int:
    """Print the sum, and the JSON where it is wanted; the exit code."""
    out = sys.stderr if parsed.json else sys.stdout
    print(f"\n{total(results)}", file=out)
    failed = any(result.outcome is Outcome.FAIL for result in results)
    if parsed.json:
        by_name = {case.name: case for case in cases}
        answers = [as_json(result, by_name[result.case]) for result in results]
        print(json.dumps({"subject": subject, "passed": not failed, "results": answers}))
    return SOME_FAIL if failed else DONE


def _ask(parsed: argparse.Namespace) -> int:
    cases = _chosen(VEHICLE_CASES, parsed.case)
    out = sys.stderr if parsed.json else sys.stdout
    _allowed(parsed)
    probe = Probe(open_link(parsed.url))
    with probe.client:
        vehicle = probe.client.wait_for_vehicle(15.0, system_id=parsed.system)
        subject = f"system {vehicle.system_id}, component {vehicle.component_id} ({vehicle.described})"
        print(f"{subject}: {len(cases)} cases\n\n{HEADING}", file=out, flush=True)
        by_name = {case.name: case for case in cases}
        results = ask_vehicle(
            probe,
            cases,
            tell=lambda text: print(text, file=sys.stderr),
            answered=lambda result: print(row(result, by_name[result.case]), file=out, flush=True),
        )
    return _finished(parsed, results, cases, subject)


def _allowed(parsed: argparse.Namespace) -> None:
    """Go on only if the user agrees."""
    warning = _WARNING.format(url=parsed.url)
    if parsed.yes:
        print(warning, file=sys.stderr)
        return
    if not sys.stdin.isatty():
        raise MisuseError(f"{warning} Add --yes")
    print(f"{warning} Continue? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise MisuseError("nothing was sent")


def _serve(parsed: argparse.Namespace) -> int:
    if not 0.5 <= parsed.quiet <= 60.0:
        raise MisuseError(f"--quiet: {parsed.quiet:g} s is not between 0.5 and 60")
    if parsed.system is not None and not 1 <= parsed.system <= 254:
        raise MisuseError(f"--system: {parsed.system} is not a vehicle's system id; use 1 to 254")
    cases = _chosen(CLIENT_CASES, parsed.case)
    if not parsed.case:  # such a case needs a user to start it
        cases = [case for case in cases if case.operation not in ON_REQUEST]
    out = sys.stderr if parsed.json else sys.stdout
    by_name = {case.name: case for case in cases}
    vehicle = FakeVehicle(
        cases,
        autopilot=AutopilotId.ARDUPILOT if parsed.autopilot == "ardupilot" else AutopilotId.PX4,
        judged=lambda result: print(row(result, by_name[result.case]), file=out, flush=True),
        quiet_s=parsed.quiet,
        system_id=parsed.system if parsed.system is not None else 1,
    )
    link = open_link(parsed.url)
    port = getattr(link, "local_port", None)
    wanted = ", ".join(dict.fromkeys(case.operation.value for case in cases))
    print(
        f"a vehicle on {parsed.url}{'' if port is None else f', port {port}'}; {wanted}\n\n{HEADING}",
        file=out,
        flush=True,
    )
    stop: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        del frame
        stop.append(number)

    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        serve(link, vehicle, stopped=lambda: bool(stop))
    finally:
        link.close()
        for number, handler in before.items():
            signal.signal(number, handler)
    for case in vehicle.open:
        print(f"not asked: {case.name} ({case.operation.value})", file=sys.stderr)
    code = _finished(parsed, vehicle.results, cases, "ground station")
    return INTERRUPTED if stop and code == DONE else code


if __name__ == "__main__":
    sys.exit(main())


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
    """Number of results for each outcome."""
    counts = Counter(result.outcome for result in results)
    return f"{len(results)} cases: " + ", ".join(f"{counts[v]} {v.value}" for v in Outcome)


VEHICLE_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (*UPLOAD_CASES, *REFUSAL_CASES, *DOWNLOAD_CASES, *LIST_CASES)
