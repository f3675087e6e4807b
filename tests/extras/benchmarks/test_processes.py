"""Work in processes: results, errors, and nobody left behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from uavcover.errors import OptimizerError, UavcoverError
from uavcover.extras.benchmarks.runs import available_cores, completed


def square(number: int) -> int:
    return number * number


def threads(_: int) -> str | None:
    return os.environ.get("OPENBLAS_NUM_THREADS")


def refuse(number: int) -> int:
    if number == 2:
        raise OptimizerError("two is not wanted")
    return number


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def process_id(_: int) -> int:
    return os.getpid()


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_every_task_with_its_result() -> None:
    assert dict(completed(square, range(7), processes=2)) == {n: n * n for n in range(7)}


def test_one_process_works_in_the_order_given() -> None:
    assert list(completed(square, [3, 1, 2], processes=1)) == [(3, 9), (1, 1), (2, 4)]


def test_nothing_to_do() -> None:
    assert list(completed(square, [], processes=4)) == []


def test_one_thread_each_and_the_environment_is_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    assert list(completed(threads, [0], processes=1)) == [(0, "1")]
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


def test_an_error_comes_through() -> None:
    with pytest.raises(OptimizerError, match="two is not wanted"):
        list(completed(refuse, [1, 2, 3], processes=1))


def test_a_killed_process_is_told_with_its_task() -> None:
    with pytest.raises(UavcoverError, match=r"^5: the process was killed"):
        list(completed(die, [5], processes=1))


def test_leaving_early_ends_the_processes() -> None:
    work = completed(process_id, range(100), processes=2)
    _, pid = next(work)
    assert is_alive(pid)
    work.close()  # type: ignore[attr-defined]
    assert not is_alive(pid)


def test_processes_end_with_a_killed_parent(tmp_path: Path) -> None:
    program = tmp_path / "parent.py"
    program.write_text(
        "import os, signal, sys\n"
        "from tests.extras.benchmarks.test_processes import process_id\n"
        "from uavcover.extras.benchmarks.runs import completed\n"
        "if __name__ == '__main__':\n"
        "    work = completed(process_id, range(3), processes=1)\n"
        "    print(next(work)[1], flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(__file__).parents[3]
    parent = subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(root)}
    )
    with parent:
        assert parent.stdout is not None
        # the orphan holds the other end of our pipe: reading ends when it has ended, too
        pid, rest = parent.stdout.readline(), parent.stdout.read()
    assert int(pid) > 0
    assert rest == ""


def test_cores() -> None:
    assert available_cores() >= 1
