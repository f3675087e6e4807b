"""Falsify the record of an honest flight in every way known here, and see that the judge passes none of them.

Usage: .venv/bin/python tests/falsify.py [RUN ...] [--bases DIR] [--seed 0] [--family NAME ...] [--workers 2] [--keep DIR]
       [--json] [-o docs/results/evidence.md]

RUN is the folder of a flight that passes, such as one of ``uavcover demo``; it is only read. With --bases, the flights of
``tests/falsifying/honest_run.py`` are falsified, and flown into DIR where they are not there yet. With --keep, rows are kept by
commit and seed, and a run that was broken off goes on. Each way is judged by the command
``uavcover verify``, in this process, on a copy:

- as the run folder itself, where hashes may give it away and a refusal (exit 2) counts as caught;
- as a survey, ``verify RUN --photos LIST``, where the photos tell the coverage;
- as a foreign log, ``verify RUN --log FILE`` beside an honest folder: what catches it is the judgement alone. Only where the
  record of the flight was changed.

A way that the judge passes, one that ends in a fault of the program, and one after which a verdict "passed" is left in the
folder are findings. A few honest ways change nothing that matters, and have to pass as a foreign log. Exit 1 with a finding.
"""

import argparse
import contextlib
import csv
import datetime
import io
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    # In place of this folder, whose packages have names of others ("coverage").
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from importlib import metadata

from scripts.options import put_section
from tests.falsifying.every_way import every_way
from tests.falsifying.flown import Flown, flights_in, read_flown
from tests.falsifying.honest_run import BASES, base_run
from tests.falsifying.way import FAMILIES, Way
from uavcover.cli.main import app, run_app

FOLDER, LOG, SURVEY = "run folder", "foreign log", "survey"
LEFT_BEHIND = ("flight.rrd", "report.html", "pareto_routes.csv", "upload.json")
"""Files of a run that are large, and that the judge does not read."""
ANSWERS = (0, 1, 2)
PASSED = "PASSED"


@dataclass(frozen=True)
class Judged:
    """What the judge said of one way.

    Attributes:
        scenario: of the flight.
        family: its kind.
        way: its name.
        judged_as: ``FOLDER``, ``LOG`` or ``SURVEY``.
        verdict: passed, failed, not proved or refused.
        exit_code: of ``uavcover verify``.
        reasons: why, as the judge says it.
        because: why it must not pass.
        finding: what is wrong with that; empty when it is as it should be.
    """

    scenario: str
    family: str
    way: str
    judged_as: str
    verdict: str
    exit_code: int
    reasons: str
    because: str
    finding: str


def command(*arguments: object) -> tuple[int, str, str]:
    """``uavcover`` in this process: its exit code, and what it wrote to stdout and stderr."""
    out, err = io.StringIO(), io.StringIO()
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numbers that no flight has may overflow
            code = run_app(app, [str(argument) for argument in arguments])
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return code, out.getvalue(), err.getvalue()


def judge(way: Way, flown: Flown, run: Path, judged_as: str, *, folder: Path) -> Judged:
    """Falsify a copy of a run, or a log beside one, in an empty folder, and have it judged.

    Args:
        way: how.
        flown: the flight that is falsified.
        run: its run folder.
        judged_as: ``FOLDER`` or ``LOG``.
        folder: where the copy goes.
    """
    copy = folder / "run"
    shutil.copytree(run, copy, ignore=shutil.ignore_patterns(*LEFT_BEHIND))
    # Beside its plan, as its number in the plan depends on it.
    record = copy / flown.folder / ("track.csv" if judged_as == FOLDER else "falsified.csv")
    if way.of_track:
        record.write_bytes(way.record(flown))
    undo = None if way.meddle is None else way.meddle(copy)
    logs = [copy / other / "track.csv" if other != flown.folder else record for other in flown.folders]
    if way.beside is not None:
        logs.append(record.with_name("falsified-too.csv"))
        logs[-1].write_text(way.beside(flown).text())
    named = [] if judged_as == FOLDER else [word for log in logs for word in ("--log", log)]
    if way.photos is not None:
        (copy / "photos.csv").write_text(way.photos(flown))
        named = ["--photos", copy / "photos.csv"]
    try:
        code, out, err = command("verify", copy, "--json", *named)
    finally:
        if undo is not None:
            undo()
    verdict_file = copy / "verification.json"
    lines = out.splitlines()
    said: dict[str, Any] = json.loads(lines[-1]) if lines else {}
    if code == 2:
        verdict, reasons = "refused", str(said.get("error", err))
    else:
        passed = bool(said.get("passed"))
        verdict = str(said.get("verdict", "passed" if passed else "failed"))
        reasons = "; ".join(said.get("reasons") or said.get("doubts") or ()) or str(said.get("error", ""))
    left = json.loads(verdict_file.read_text()) if verdict_file.is_file() else {}
    finding = ""
    if code not in ANSWERS:
        finding = f"ended with {code}: {said.get('error', err)[-300:]}"
    elif way.honest:
        finding = "" if code == 0 else "an honest one did not pass"
    elif code == 0 or verdict == "passed":
        finding = PASSED
    elif judged_as == FOLDER and left.get("passed"):
        finding = "caught, but a verdict in the folder says passed"
    reasons = " ".join(reasons.replace(str(folder), "").split())
    scenario = flown.site.scenario.name
    return Judged(scenario, way.family, way.name, judged_as, verdict, code, reasons, way.because, finding)


def judged_as_of(way: Way) -> list[str]:
    """As what a way is judged."""
    if way.photos is not None:
        return [SURVEY]
    if way.as_log_alone:
        return [LOG]
    return [FOLDER, LOG] if way.of_track and way.meddle is None else [FOLDER]


def judge_all(
    run: Path, *, seed: int = 0, families: Collection[str] = (), count: int | None = None,
    known: Collection[tuple[str, str, str]] = (),
) -> Iterator[Judged]:  # fmt: skip
    """Judge every way, or ``count`` of them drawn by the seed, as often as it can be judged; not those that are known."""
    flights = [read_flown(run, flight) for flight in flights_in(run)]
    chosen = np.random.default_rng([seed, 1]).integers(len(flights), size=10_000)
    ways = [every_way(flown, seed=seed, families=families) for flown in flights]
    numbers = np.arange(max(map(len, ways)))
    if count is not None and count < len(numbers):
        numbers = np.sort(np.random.default_rng(seed).choice(numbers, count, replace=False))
    for number in numbers:
        flown = flights[chosen[number]]
        if number >= len(ways[chosen[number]]):
            continue  # another flight of the run gives occasion for more ways
        way = ways[chosen[number]][number]
        kinds = judged_as_of(way)
        for judged_as in kinds:
            if (way.family, way.name, judged_as) in known:
                continue
            with tempfile.TemporaryDirectory() as folder:
                yield judge(way, flown, run, judged_as, folder=Path(folder))


def summary(rows: Sequence[Judged]) -> dict[str, int]:
    """The figures."""
    false = [row for row in rows if row.family != "honest"]
    figures = {"ways": len({(row.scenario, row.family, row.way) for row in false})}
    for judged_as in (FOLDER, LOG, SURVEY):
        of_it = [row for row in false if row.judged_as == judged_as]
        figures[f"as {judged_as}"] = len(of_it)
        figures[f"as {judged_as}, caught"] = sum(row.finding != PASSED for row in of_it)
    honest = [row for row in rows if row.family == "honest"]
    return {**figures, "honest": len(honest), "honest, passed": sum(not row.finding for row in honest)}


def _reported(figures: dict[str, int]) -> str:
    return ", ".join(f"{name}: {value}" for name, value in figures.items()) + "."


def table(rows: Sequence[Judged], words: str) -> str:
    """The section of a page: what was found by family, and every finding."""
    lines = [
        words, "", "Together: " + _reported(summary(rows)), "",
        *(f"- {name}: {_reported(summary([row for row in rows if row.scenario == name]))}"
          for name in dict.fromkeys(row.scenario for row in rows)), "",
        "| family | as run folder: caught | as foreign log: caught | as survey: caught | verdicts as foreign log |",
        "|---|---:|---:|---:|---|",
    ]  # fmt: skip
    for name in dict.fromkeys(row.family for row in rows):
        cells = []
        for judged_as in (FOLDER, LOG, SURVEY):
            of_it = [row for row in rows if row.family == name and row.judged_as == judged_as]
            fine = sum(not row.finding if row.family == "honest" else row.finding != PASSED for row in of_it)
            cells.append(f"{fine} of {len(of_it)}" if of_it else "-")
        verdicts = [row.verdict for row in rows if row.family == name and row.judged_as == LOG]
        counted = ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)) or "-"
        lines.append(f"| {name} | {cells[0]} | {cells[1]} | {cells[2]} | {counted} |")
    findings = [row for row in rows if row.finding]
    lines += ["", "Findings:" if findings else "Findings: none.", ""]
    for scenario, family, way in dict.fromkeys((row.scenario, row.family, row.way) for row in findings):
        of_it = [row for row in findings if (row.scenario, row.family, row.way) == (scenario, family, way)]
        said = "; ".join(f"as {row.judged_as}: {row.finding}" for row in of_it)
        lines.append(f"- {scenario}: {family}, {way} ({of_it[0].because}): {said}")
    return "\n".join(lines) + "\n"


def write_csv(path: Path, rows: Sequence[Judged]) -> None:
    """Every row, without the judge's words, which hold figures of no interest here."""
    names = [field.name for field in fields(Judged) if field.name != "reasons"]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows_out = csv.writer(file, lineterminator="\n")
        rows_out.writerows([names, *([asdict(row)[name] for name in names] for row in rows)])


def commit() -> str:
    """The commit that judges."""
    reported = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--abbrev=12"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    )
    return reported.stdout.strip() or "unknown"


def _judged(
    run: Path, *, seed: int, families: Collection[str], count: int | None, keep: Path | None, on_stderr: object
) -> list[Judged]:
    """The rows of one run: those that are kept, and the others, which are printed and kept as they come."""
    rows: list[Judged] = []
    file = None
    if keep is not None:
        name = "-".join([*run.resolve().parts[-3:], commit(), str(seed)])
        path = keep / f"{name}.jsonl"
        keep.mkdir(parents=True, exist_ok=True)
        if path.is_file():
            whole = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
            path.write_text("".join(whole))  # a line that was broken off goes
            rows = [Judged(**json.loads(line)) for line in whole]
            rows = [row for row in rows if not families or row.family in families]
        file = path.open("a", encoding="utf-8")
    with contextlib.ExitStack() as stack:
        if file is not None:
            stack.enter_context(file)
        known = {(row.family, row.way, row.judged_as) for row in rows}
        for row in judge_all(run, seed=seed, families=families, count=count, known=known):
            rows.append(row)
            if file is not None:
                print(json.dumps(asdict(row)), file=file, flush=True)
            line = f"{row.finding or 'ok':8} {row.verdict:10} {row.family}, {row.way}, as {row.judged_as}: {row.reasons[:160]}"
            print(line, file=sys.stderr if on_stderr else sys.stdout, flush=True)
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Judge all, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="*", metavar="RUN", help="folder of an honest flight that passes")
    parser.add_argument(
        "--bases", type=Path, metavar="DIR", help="falsify the flights of this folder, flown if need be"
    )
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes, one run each at a time; default 1"
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep rows here, and judge none that are there")
    parser.add_argument("--seed", type=int, default=0, help="of the parameters; default 0")
    parser.add_argument("--ways", type=int, metavar="N", help="only so many, drawn by the seed; default all")
    parser.add_argument("--family", action="append", default=[], metavar="NAME", help="only this kind; may be repeated")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout, progress on stderr")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="TABLE",
        help=".md: its section is renewed, with falsified.csv beside it; or .csv alone",
    )
    chosen = parser.parse_args(arguments)
    unknown = set(chosen.family) - {*FAMILIES, "two at once"}
    if unknown:
        parser.error(f"no family {', '.join(sorted(unknown))}; there are {', '.join([*FAMILIES, 'two at once'])}")
    if not chosen.runs and chosen.bases is None:
        parser.error("name a RUN, or --bases DIR")
    print(f"commit {commit()}", file=sys.stderr, flush=True)
    judged = partial(
        _judged,
        seed=chosen.seed,
        families=tuple(chosen.family),
        count=chosen.ways,
        keep=chosen.keep,
        on_stderr=chosen.json,
    )
    runs = [*chosen.runs]
    if chosen.bases is not None:
        runs += [base_run(chosen.bases / name.replace(" ", "_"), name) for name in BASES]
    with ProcessPoolExecutor(chosen.workers, mp_context=get_context("spawn")) as pool:
        each = pool.map if chosen.workers > 1 else map
        rows = list(itertools.chain.from_iterable(each(judged, runs)))
    findings = [row for row in rows if row.finding]
    if chosen.json:
        print(
            json.dumps(
                {**summary(rows), "findings": [asdict(row) for row in findings], "rows": [asdict(r) for r in rows]}
            )
        )
    else:
        print(", ".join(f"{name}: {value}" for name, value in summary(rows).items()))
    if chosen.out is not None:
        if chosen.out.suffix == ".md":
            ways = "" if chosen.ways is None else f" --ways {chosen.ways}"
            words = (
                f"Command: `.venv/bin/python tests/falsify.py RUN ... --seed {chosen.seed}{ways}`, "
                f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, {os.cpu_count()} cores, "
                f"commit {commit()}. "
                "What is done is said at the top of the command, what each way is in `tests/falsifying`. "
                "Every way: [falsified.csv](falsified.csv)."
            )
            put_section(chosen.out, "Falsified flights", table(rows, words))
        write_csv(chosen.out if chosen.out.suffix == ".csv" else chosen.out.with_name("falsified.csv"), rows)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
