"""The results of a run of the matrix, as Markdown for people and CSV for programs."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from sitl_tests.matrix import Cell
from sitl_tests.run import Result

COLUMNS = (
    "vehicle", "capability", "client", "outcome", "expected", "as_expected", "why", "detail", "vehicle_version",
    "wall_s", "log", "log_sha256",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What a table must say to be worth anything.

    Attributes:
        date: of the run.
        command: that made it.
        versions: of what took part, by name.
    """

    date: str
    command: str
    versions: Mapping[str, str]


def csv_text(results: Iterable[Result]) -> str:
    """A row for each cell and log; cells without a log have one row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for result in results:
        for name, sha in result.log_sha256.items() or [("", "")]:
            writer.writerow(_row(result, name, sha))
    return text.getvalue()


def markdown_text(results: Sequence[Result], skipped: Mapping[str, str], circumstances: Circumstances) -> str:
    """The table of outcomes, what each capability showed, and the logs' checksums.

    Args:
        results: of the cells that were run.
        skipped: vehicles that were not there, with the reason.
        circumstances: of the run.
    """
    lines = [
        "# What each vehicle does",
        "",
        f"Run on {circumstances.date} by `{circumstances.command}`; see [how to run it](../how-to/sitl.md).",
        "",
        *(f"- {name}: {version}" for name, version in circumstances.versions.items()),
        *(f"- {name}: not run: {reason}" for name, reason in skipped.items()),
        "",
        *_outcomes(results),
        "",
        *_details(results),
        "",
        *_logs(results),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _row(result: Result, log: str, sha256: str) -> tuple[object, ...]:
    cell, finding = result.cell, result.finding
    requested = (cell.vehicle.name, cell.capability, cell.client)
    judged = (finding.outcome, cell.expected.outcome, result.as_expected, cell.expected.why, finding.detail)
    return (*requested, *judged, result.version, f"{result.wall_s:.1f}", log, sha256)


def _outcomes(results: Sequence[Result]) -> list[str]:
    vehicles = list(dict.fromkeys(result.cell.vehicle.name for result in results))
    found = {(result.cell.capability, result.cell.client, result.cell.vehicle.name): result for result in results}
    rows = dict.fromkeys((result.cell.capability, result.cell.client) for result in results)
    good = sum(result.as_expected for result in results)
    lines = [
        f'{good} of {len(results)} cells came out as expected. A word other than "works" is what the vehicle does by nature; '
        "why is said below. **Bold** is not what was expected.",
        "",
        f"| capability | client | {' | '.join(vehicles)} |",
        f"|---|---|{'---|' * len(vehicles)}",
    ]
    for capability, client in rows:
        entries = [_entry(found.get((capability, client, vehicle))) for vehicle in vehicles]
        lines.append(f"| {capability} | {client} | {' | '.join(entries)} |")
    return lines


def _entry(result: Result | None) -> str:
    if result is None:
        return "-"
    outcome = result.finding.outcome
    return outcome if result.as_expected else f"**{outcome}** (expected {result.cell.expected.outcome})"


def _details(results: Sequence[Result]) -> list[str]:
    lines: list[str] = []
    for capability in dict.fromkeys(result.cell.capability for result in results):
        of_it = [result for result in results if result.cell.capability == capability]
        lines += [
            f"## {capability}",
            "",
            f"{_sentence(of_it[0].cell)}",
            "",
            "| vehicle | client | outcome | what was seen |",
            "|---|---|---|---|",
        ]
        for result in of_it:
            cell = result.cell
            why = f" ({cell.expected.why})" if cell.expected.why else ""
            lines.append(
                f"| {cell.vehicle.name} | {cell.client} | {result.finding.outcome} | {_cell(result.finding.detail + why)} |"
            )
        lines.append("")
    return lines


def _logs(results: Sequence[Result]) -> list[str]:
    with_logs = [result for result in results if result.log_sha256]
    if not with_logs:
        return []
    lines = ["## Logs of the flights", "", "| vehicle | capability | client | log | SHA-256 |", "|---|---|---|---|---|"]
    for result in with_logs:
        cell = result.cell
        for name, sha in result.log_sha256.items():
            lines.append(f"| {cell.vehicle.name} | {cell.capability} | {cell.client} | {name} | `{sha}` |")
    return lines


def _sentence(cell: Cell) -> str:
    return cell.shows[0].upper() + cell.shows[1:] + "."


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
