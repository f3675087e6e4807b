"""Tasks on workers, and the input that they share."""

import errno
import os
import socket
import sys
import threading

import numpy as np
import pytest

from uavcover.errors import InputError, TerrainError, UavcoverError
from uavcover.run import provenance as programs
from uavcover.run import scheduling
from uavcover.run.provenance import differences, program
from uavcover.run.scheduling import can_share_files, read_shared, shared_file, workers_of


@pytest.mark.parametrize(
    "text",
    ["", "threads", "local:", "local:0", "local:-1", "local:two", "local:2:3", "local:٣", "tcp:", "tcp://", "tcp://host",
     "tcp://:8786", "tcp://host:0", "tcp://host:65536", "tcp://host:x", "udp://host:8786", "tcp:host:8786", "LOCAL"],
)  # fmt: skip
def test_what_is_no_scheduler_is_refused(text) -> None:
    with pytest.raises(InputError, match=r"--scheduler: unknown scheduler .*; use local, local:N"):
        workers_of(text)


def test_without_dask_the_error_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "dask", None)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        InputError, match=r"--scheduler local:2: requires Dask: pip install 'uavcover\[cluster\]'"
    ) as reported:
        workers_of("local:2")
    assert reported.value.exit_code == 2


def test_programs_that_differ_are_told_apart() -> None:
    ours = program()
    assert differences(ours, dict(ours)) == ""
    assert differences(ours, ours | {"numpy": "1.0"}) == f"numpy {ours['numpy']} here and 1.0 there"
    assert differences({"a": "1"}, {}) == "a 1 here and none there"
    assert {"uavcover", "uavcover's sources", "python", "numpy", "numba"} <= ours.keys()


def add(shared: int, task: int) -> int:
    if task < 0:
        raise TerrainError(f"no ground at {task}")
    if task == 13:
        raise ConnectionRefusedError("by what the task asks")
    return shared + task


@pytest.fixture(scope="module")
def workers():
    """A scheduler and a worker in this process."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    import dask

    with (
        dask.config.set({"distributed.admin.system-monitor.gil.enabled": False}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address="127.0.0.1:0", protocol="inproc://"
        ) as local,
        distributed.Client(local, set_as_default=False) as client,
    ):  # fmt: skip
        yield scheduling.Workers(client, "--scheduler test")


def test_dask_gives_each_task_with_its_result(workers) -> None:
    assert workers.count == 2
    assert sorted(workers.completed(add, 100, list(range(12)))) == [(k, 100 + k) for k in range(12)]
    assert sorted(workers.completed(add, 200, [5, 5])) == [(5, 205), (5, 205)]
    assert list(workers.completed(add, 0, [])) == []


def test_workers_of_this_machine_read_what_they_need_from_a_file_once(workers, monkeypatch) -> None:
    if not can_share_files():
        pytest.skip("needs /proc")
    opened, real = [], scheduling.read_shared
    monkeypatch.setattr(scheduling, "read_shared", lambda path: [opened.append(path), real(path)][1])
    here = scheduling.Workers(workers._client, "--scheduler test", here=True)
    for _ in range(2):
        assert sorted(here.completed(add, 300, list(range(6)))) == [(k, 300 + k) for k in range(6)]
    assert 1 <= len(opened) <= 2  # two threads of one worker may begin at the same moment
    assert sorted(here.completed(add, 400, [1])) == [(1, 401)]
    with pytest.raises(TerrainError, match="no ground at -3"):
        list(here.completed(add, 400, [1, -3, 2]))
    monkeypatch.setattr(scheduling, "program", lambda: {"numpy": "0"})
    with pytest.raises(InputError, match=r"a worker runs different software: .*numpy"):
        list(here.completed(add, 500, [1]))


def test_an_error_of_a_task_comes_as_it_was_raised(workers) -> None:
    with pytest.raises(TerrainError, match="no ground at -3"):
        list(workers.completed(add, 100, [1, -3, 2]))
    with pytest.raises(ConnectionRefusedError, match="by what the task asks"):
        list(workers.completed(add, 100, [13]))
    assert sorted(workers.completed(add, 100, [1, 2])) == [(1, 101), (2, 102)]


FIRST, GATE = threading.Lock(), threading.Event()


def first_only(shared: int, task: int) -> int:
    """Whichever task comes first is done at once: Dask begins with any of those that were given together."""
    if not FIRST.acquire(blocking=False):
        GATE.wait(60.0)
    return shared + task


def test_who_stops_gets_what_is_done_and_no_more(workers) -> None:
    got = []
    try:
        for task, _ in workers.completed(first_only, 0, list(range(5)), should_stop=lambda: len(got) >= 1):
            got.append(task)
        assert len(got) == 1
    finally:
        GATE.set()
    assert list(workers.completed(add, 0, [1], should_stop=lambda: True)) == []


def test_a_worker_of_another_program_is_refused(workers, monkeypatch) -> None:
    monkeypatch.setattr(workers, "_about", program() | {"numba": "0.1"})
    with pytest.raises(
        InputError, match=r"a worker runs different software: numba 0.1 here and .* there; install the same"
    ):
        list(workers.completed(add, 300, [1]))


def test_nobody_at_the_address_is_one_error(monkeypatch) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    monkeypatch.setattr("uavcover.run.scheduling._ANSWER_S", 0.2)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: refused
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with (
            pytest.raises(
                InputError, match=f"{address}: no Dask scheduler answers at this address; start one with"
            ) as reported,
            workers_of(address),
        ):
            pass
    assert reported.value.exit_code == 2


def test_processes_of_this_machine_do_the_tasks_and_end() -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (extra cluster)")
    with workers_of("local:1") as workers:
        assert workers.count == 1
        assert sorted(workers.completed(add, 100, [1, 2])) == [(1, 101), (2, 102)]


def test_the_hash_of_the_sources_is_of_all_of_them(monkeypatch, tmp_path) -> None:
    package = tmp_path / "uavcover" / "run"
    package.mkdir(parents=True)
    monkeypatch.setattr(programs, "__file__", str(package / "program.py"))
    (package / "a.py").write_text("x = 1")
    before = programs._sources_sha256()
    (package / "a.py").write_text("x = 2")
    assert programs._sources_sha256() != before


pytestmark = pytest.mark.skipif(not can_share_files(), reason="needs /proc")


def frozen(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values


def test_what_is_read_is_what_was_shared_and_large_arrays_are_the_file_itself() -> None:
    rng = np.random.default_rng(1)
    large = frozen(rng.normal(size=(300, 71)))
    other = frozen(rng.integers(0, 200, 70_001).astype(np.uint8))
    value = {"large": large, "other": other, "small": frozen(np.arange(3.0)), "mine": np.zeros((200, 100)), "text": "ü"}
    shared = shared_file(value)
    with shared.file:
        read, again = read_shared(shared.path), read_shared(shared.path)
        assert shared.size == os.fstat(shared.file.fileno()).st_size
    # The file is closed, and no other process has a name for it.
    for name in ("large", "other", "small", "mine"):
        assert np.array_equal(read[name], value[name])
        assert read[name].dtype == value[name].dtype
        # Compiled code is made for one kind: read-only or not, aligned or not.
        assert read[name].flags.writeable == value[name].flags.writeable
        assert read[name].flags.aligned
    assert read["text"] == "ü"
    assert not read["large"].flags.owndata
    assert read["large"].ctypes.data % 64 == read["other"].ctypes.data % 64 == 0
    read["mine"][0, 0] = 1.0
    assert again["mine"][0, 0] == value["mine"][0, 0] == 0.0


def test_equal_objects_have_equal_hashes_and_others_do_not() -> None:
    found = []
    for values in (np.zeros(9_000), np.zeros(9_000), np.ones(9_000)):
        shared = shared_file(("site", frozen(values)))
        shared.file.close()
        found.append(shared.sha256)
    assert found[0] == found[1] != found[2]


def test_a_full_disk_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        closed = False

        def write(self, _: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        def close(self) -> None:
            self.closed = True

    full = Full()
    monkeypatch.setattr(scheduling.tempfile, "TemporaryFile", lambda: full)
    with pytest.raises(UavcoverError, match=r"^--scheduler: cannot write .*No space left on device.*TMPDIR"):
        shared_file("site")
    assert full.closed
