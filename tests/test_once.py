"""What is made once is made once, also where several want it at the same moment."""

import threading
from pathlib import Path

import pytest

from tests.once import made_once


class _Factory:
    """Stands for pytest's: the base folder is the same for all."""

    def __init__(self, base: Path) -> None:
        self.base = base

    def getbasetemp(self) -> Path:
        return self.base


def _want(base: Path) -> None:
    def make(folder: Path) -> None:
        with (base / "calls").open("a") as calls:
            calls.write("made\n")
        (folder / "content").write_text("there")

    folder = made_once(_Factory(base), "shared", make)  # type: ignore[arg-type]
    with (base / "seen").open("a") as seen:
        seen.write((folder / "content").read_text() + "\n")


def test_all_that_want_it_at_once_share_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    # A lock of a file keeps apart whoever opened it, threads as well as processes.
    threads = [threading.Thread(target=_want, args=(tmp_path,)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (tmp_path / "calls").read_text() == "made\n"
    assert (tmp_path / "seen").read_text() == "there\n" * 8


def test_what_failed_is_tried_again_and_workers_share_their_parents_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw0")
    factory = _Factory(tmp_path / "popen-gw0")

    def fail(folder: Path) -> None:
        raise OSError(folder)

    with pytest.raises(OSError, match="shared"):
        made_once(factory, "shared", fail)  # type: ignore[arg-type]
    folder = made_once(factory, "shared", lambda folder: (folder / "content").touch())  # type: ignore[arg-type]
    assert folder == tmp_path / "shared"
    assert (folder / "content").exists()
