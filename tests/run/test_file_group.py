"""A group of changes is made or not, wherever the process is killed and whatever is in the way."""

import contextlib
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from uavcover.errors import OutputError
from uavcover.run import file_group
from uavcover.run.file_group import change_together, settle, write_file
from uavcover.run.folder import RunFolder

OPERATIONS = ("mkdir", "rename", "replace", "unlink", "rmdir", "open", "fsync", "chmod", "link", "symlink")
"""Of ``os``: what pathlib, tempfile and shutil call as well."""
OPERATIONS_OF_A_FILE = 4
"""Folder, file, content, and its name: the last one is not done."""


class Killed(BaseException):
    """Stands for kill -9: nothing that the process does after it has any effect."""


class Group:
    """A folder before, and a seeded change of it."""

    def __init__(self, seed: int) -> None:
        rng = random.Random(seed)
        names = [f"{name}.json" for name in "abcdefgh"]
        self.before: dict[str, str] = {name: f"old {name}" for name in rng.sample(names, rng.randint(1, 6))}
        if rng.random() < 0.6:
            self.before |= {f"sortie-1/{name}": f"old {name}" for name in rng.sample(names, 2)}
        self.contents = {name: f"new {name}" for name in rng.sample(names, rng.randint(1, 5))}
        self.contents |= {
            f"sortie-{rng.randint(1, 2)}/{name}": f"new {name}" for name in rng.sample(names, rng.randint(0, 2))
        }
        self.removed = rng.sample(names, rng.randint(1, 4))
        self.moved: dict[str, str] = {}
        if rng.random() < 0.5:
            self.moved = {name: f"older-1/{name}" for name in self.before if "/" not in name}
            if any("/" in name for name in self.before):
                self.moved["sortie-1"] = "older-1/sortie-1"
        after = {name: text for name, text in self.before.items() if name not in self.removed or name in self.contents}
        if self.moved:
            after = {f"older-1/{name}": text for name, text in self.before.items()}
        self.after = after | self.contents

    def lay(self, folder: Path) -> None:
        for name, text in self.before.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)

    def change(self, folder: Path) -> None:
        contents = {name: text.encode() for name, text in self.contents.items()}
        change_together(folder, contents, removed=self.removed, moved=self.moved)


def held(folder: Path) -> dict[str, str]:
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def failing(
    monkeypatch: pytest.MonkeyPatch, after: int, error: Callable[[], BaseException], *, for_good: bool
) -> list[int]:
    """Let the operation of this number fail, and with ``for_good`` all after it; the count of operations."""
    count = [0]

    def wrap(name: str) -> None:
        real = getattr(os, name)

        def call(*arguments: object, **options: object) -> object:
            count[0] += 1
            if count[0] == after or (for_good and count[0] > after):
                raise error()
            return real(*arguments, **options)

        monkeypatch.setattr(os, name, call)

    for name in OPERATIONS:
        wrap(name)
    return count


def operations_of(group: Group, folder: Path) -> int:
    group.lay(folder)
    with pytest.MonkeyPatch.context() as patch:
        count = failing(patch, 0, Killed, for_good=False)
        group.change(folder)
    assert held(folder) == group.after
    shutil.rmtree(folder)
    folder.mkdir()
    return count[0]


@pytest.mark.parametrize("seed", range(6))
def test_killed_before_any_operation(seed: int, tmp_path: Path) -> None:
    group, folder = Group(seed), tmp_path / "run"
    folder.mkdir()
    ends = set()
    for after in range(1, operations_of(group, folder) + 1):
        group.lay(folder)
        with pytest.MonkeyPatch.context() as patch:
            failing(patch, after, Killed, for_good=True)
            with pytest.raises(Killed):
                group.change(folder)
        # The next command opens the folder; it may be killed as well.
        for again in (3, 6, 9):
            with pytest.MonkeyPatch.context() as patch:
                failing(patch, again, Killed, for_good=True)
                with contextlib.suppress(Killed):
                    settle(folder)
        settle(folder)
        found = held(folder)
        assert found in (group.before, group.after), f"a mixture after operation {after}"
        ends.add(found == group.after)
        shutil.rmtree(folder)
        folder.mkdir()
    assert ends == {False, True}


@pytest.mark.parametrize("seed", range(6))
def test_an_error_at_any_operation(seed: int, tmp_path: Path) -> None:
    """Of the disk, once: what was changed is taken back, and one line says so."""
    group, folder = Group(seed), tmp_path / "run"
    folder.mkdir()
    for after in range(1, operations_of(group, folder) + 1):
        group.lay(folder)
        with pytest.MonkeyPatch.context() as patch:
            failing(patch, after, lambda: OSError(28, "No space left on device"), for_good=False)
            try:
                group.change(folder)
                expected = group.after
            except OutputError:  # and no other
                expected = group.before
        settle(folder)
        assert held(folder) == expected, f"operation {after}"
        shutil.rmtree(folder)
        folder.mkdir()


@pytest.mark.parametrize("seed", range(6))
def test_a_directory_in_the_way_of_any_file(seed: int, tmp_path: Path) -> None:
    group = Group(seed)
    for number, name in enumerate([name for name in group.contents if name not in group.moved]):
        folder = tmp_path / str(number)
        group.lay(folder)
        (folder / name).unlink(missing_ok=True)
        (folder / name / "inside").mkdir(parents=True)
        if group.moved and name.startswith("sortie-1/"):
            continue  # it goes away with its folder
        before = held(folder)
        with pytest.raises(OutputError, match=f"{name}: this is a directory"):
            group.change(folder)
        assert held(folder) == before
        assert not list(folder.glob(".uavcover*"))


PROGRAM = """
import os, sys
from pathlib import Path
from uavcover.run.folder import RunFolder
left = [int(sys.argv[2])]
def wrap(name):
    real = getattr(os, name)
    def call(*arguments, **options):
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), 9)
        return real(*arguments, **options)
    setattr(os, name, call)
for name in ("rename", "replace", "unlink"):
    wrap(name)
run = RunFolder(sys.argv[1])
with run.reserved((), force=True):
    run.write_together({"plan.json": "new", "mission.waypoints": "new", "run.json": "{}"}, stale=["upload.json"])
"""


def test_readers_after_a_real_kill_see_no_mixture(tmp_path: Path) -> None:
    ends = []
    for after in range(1, 20):
        folder = tmp_path / str(after)
        folder.mkdir()
        for name in ("plan.json", "mission.waypoints", "upload.json"):
            (folder / name).write_text("old")
        (folder / "run.json").write_text("{}")
        code = subprocess.run([sys.executable, "-c", PROGRAM, folder, str(after)], timeout=300, check=False).returncode
        run = RunFolder(folder)
        plan = run.existing("plan.json", made_by="uavcover plan").read_text()
        rest = {run.file(name).read_text() for name in ("mission.waypoints",)}
        assert rest == {plan}
        assert run.file("upload.json").exists() == (plan == "old")
        ends.append((code, plan))
        if code == 0:
            break
    assert ends[0] == (-9, "old")
    assert (-9, "new") in ends
    assert ends[-1] == (0, "new")


def test_a_file_half_written_when_killed_goes_with_the_next_command(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("old")
    with pytest.MonkeyPatch.context() as patch:
        failing(patch, OPERATIONS_OF_A_FILE, Killed, for_good=True)
        with pytest.raises(Killed):
            write_file(tmp_path / "a.csv", b"new")
    assert len(held(tmp_path)) == 2
    settle(tmp_path)
    assert held(tmp_path) == {"a.csv": "old"}


def test_a_journal_that_cannot_be_finished_is_named(tmp_path: Path) -> None:
    (tmp_path / file_group.JOURNAL).write_text("{")
    run = RunFolder(tmp_path)
    with pytest.raises(OutputError, match="replacing files was interrupted"):
        run.existing("plan.json", made_by="uavcover plan")
