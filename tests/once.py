"""Folders that are made once for all processes of a test run, by whichever needs them first."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder with what ``make`` puts into it; the other processes wait for it and find it made. Not to be changed: copy it.

    Args:
        factory: of this process.
        name: of the folder, the same in all processes.
        make: gets the empty folder; when it fails, the next process that needs the folder tries again.
    """
    # Under xdist each worker has a folder of its own in one that belongs to the run.
    base = factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, done = shared / name, shared / f"{name}.made"
    with (shared / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not done.exists():
            folder.mkdir(exist_ok=True)
            make(folder)
            done.touch()
    return folder
