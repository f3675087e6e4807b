"""``python -m sitl_tests -o FILE.md``: run the matrix on all vehicles that are there, and write the table."""

import argparse
import platform
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from sitl_tests.errors import MissingSimulatorError, SitlError
from sitl_tests.matrix import Cell, load_matrix
from sitl_tests.results import Circumstances, csv_text, markdown_text
from sitl_tests.run import Result, kept_result, run_cell

_PACKAGES = ("uavcover", "pymavlink", "mavsdk")


def main(arguments: Sequence[str]) -> int:
    """Run what was asked for; 0 when every cell came out as expected, 1 when not, 2 for bad usage."""
    options = _parser().parse_args(arguments)
    cells = [cell for cell in load_matrix() if _is_wanted(cell, options)]
    if not cells:
        print("no cell of the matrix fits these options", file=sys.stderr)
        return 2
    logs = Path(options.logs) if options.logs is not None else Path(tempfile.mkdtemp(prefix="uavcover-sitl-"))
    print(f"logs of each case in {logs}", file=sys.stderr)
    results: list[Result] = []
    skipped: dict[str, str] = {}
    try:
        for result in _results(cells, logs, options.seed, skipped):
            results.append(result)
    except KeyboardInterrupt:
        print("stopped; what was run is written", file=sys.stderr)
    circumstances = Circumstances(
        datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        shlex.join(["python", "-m", "sitl_tests", *arguments]),
        _versions(results),
    )
    target = Path(options.output)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(markdown_text(results, skipped, circumstances), encoding="utf-8")
    target.with_suffix(".csv").write_text(csv_text(results), encoding="utf-8")
    good = sum(result.as_expected for result in results)
    print(f"{good} of {len(results)} as expected; {target} and {target.with_suffix('.csv')}", file=sys.stderr)
    return 0 if good == len(results) else 1


def _results(cells: Sequence[Cell], logs: Path, seed: int, skipped: dict[str, str]) -> Iterator[Result]:
    for number, cell in enumerate(cells, 1):
        if cell.vehicle.name in skipped:
            continue
        folder = logs / cell.name
        kept = kept_result(cell, folder)
        if kept is not None:
            yield kept
            continue
        if folder.exists():  # stopped in the middle
            shutil.rmtree(folder)
        try:
            result = run_cell(cell, folder, seed=seed)
        except MissingSimulatorError as error:
            skipped[cell.vehicle.name] = str(error)
            print(f"{cell.vehicle.name}: {error}", file=sys.stderr)
            continue
        mark = "" if result.as_expected else f"   NOT {cell.expected.outcome}"
        print(
            f"{number:3d}/{len(cells)} {cell.name}: {result.finding.outcome} in {result.wall_s:.0f} s; "
            f"{result.finding.detail}{mark}",
            file=sys.stderr,
        )
        yield result


def _is_wanted(cell: Cell, options: argparse.Namespace) -> bool:
    return (
        (not options.vehicle or cell.vehicle.name in options.vehicle)
        and (not options.capability or cell.capability in options.capability)
        and (not options.client or cell.client in options.client)
    )


def _versions(results: Sequence[Result]) -> dict[str, str]:
    versions = {"Python": platform.python_version()}
    versions |= {name: metadata.version(name) for name in _PACKAGES}
    for result in results:
        versions[result.cell.vehicle.name] = f"{result.version}, {result.cell.vehicle.speed:g} times real time"
    return versions


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl_tests", description=__doc__)
    parser.add_argument("-o", "--output", required=True, help="the Markdown file; the CSV lands beside it")
    parser.add_argument("--vehicle", action="append", help="only this vehicle (repeatable)")
    parser.add_argument("--capability", action="append", help="only this capability (repeatable)")
    parser.add_argument("--client", action="append", help="only this client (repeatable)")
    parser.add_argument(
        "--logs", help="folder for the logs of the cases; cases that were run in it before are not run again"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the lossy links")
    return parser


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):  # also in the background: vehicles are ended, results written
        signal.signal(number, signal.default_int_handler)
    try:
        sys.exit(main(sys.argv[1:]))
    except SitlError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(3)
