"""Deletes each row of each transition table in turn and sees whether a protocol test fails.

    python scripts/attack/mutate_tables.py [-j PROCESSES] [-o PAGE.md]

Each row is deleted in a forked child that runs the tests until the first failure; nothing in the package knows of it.
Exit code 0 when every deletion was noticed, 1 when one was not.
"""

import argparse
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from scripts.options import file_to_write

ROOT = Path(__file__).resolve().parents[2]
HEAD = """# Every row of the transition tables is needed

Written by `scripts/attack/mutate_tables.py`: each row was deleted in turn, and the tests were run.
"""
TESTS = "tests/mission_io/protocol/test_tables.py"


def tests_fail(name: str, number: int | None, log: Path) -> bool:
    """Whether a table's tests fail without row ``number``, in a child; None deletes nothing."""
    child = os.fork()
    if child == 0:
        code = 70
        try:
            output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(output, 1)
            os.dup2(output, 2)
            code = run_without(name, number)
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code not in (0, 1):
        raise SystemExit(f"{name} row {number}: the tests could not run (exit code {code}); see {log}")
    log.unlink()
    return code == 1


def run_without(name: str, number: int | None) -> int:
    """Run the tests in this process with a row deleted from the table in memory; pytest's exit code."""
    import pytest

    from tests.mission_io.protocol.diagrams import TABLES

    if number is not None:
        table, _ = TABLES[name]
        row = table.rows[number]
        table.rows = table.rows[:number] + table.rows[number + 1 :]
        del table._rows[row.state, row.event]
    # Only the scripts: the test that deletes rows by itself would fail for another reason.
    return int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-k", f"test_script and {name}", TESTS]))


def main() -> int:
    """Try every row, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-j", "--processes", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("-o", "--out", type=file_to_write)
    arguments = parser.parse_args()
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    import pytest  # noqa: F401  (once, for all children)

    from tests.mission_io.protocol.diagrams import TABLES

    log = Path(os.environ.get("TMPDIR", "/tmp")) / f"mutate_tables.{os.getpid()}"
    began = time.monotonic()
    for name in TABLES:
        if tests_fail(name, None, log):
            raise SystemExit(f"{name}: the tests fail with every row there; see them by running pytest {TESTS}")
    jobs = [(name, number) for name, (table, _) in TABLES.items() for number in range(len(table.rows))]
    with ThreadPoolExecutor(arguments.processes) as pool:
        found = list(pool.map(lambda job: tests_fail(*job, Path(f"{log}.{job[0]}.{job[1]}")), jobs))
    lines = ["| table | rows | deletions that a test noticed |", "|---|---|---|"]
    for name, (table, _) in TABLES.items():
        kills = sum(hit for (table_name, _), hit in zip(jobs, found, strict=True) if table_name == name)
        lines.append(f"| {name} | {len(table.rows)} | {kills} |")
    survivors = [job for job, hit in zip(jobs, found, strict=True) if not hit]
    for name, number in survivors:
        row = TABLES[name][0].rows[number]
        lines.append(f"\nNot noticed: {name}: {row.state.name}, {row.event.name}")
    text = "\n".join(lines) + "\n"
    print(f"{text}{time.monotonic() - began:.0f} s")
    if arguments.out:
        arguments.out.write_text(f"{HEAD}\n{text}")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
