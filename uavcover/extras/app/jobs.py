"""Commands that the page starts. Each is a separate process, which continues when the server ends.

A job is a folder: ``job.json`` has its command, ``events`` its messages (``--events``), ``result`` its answer (``--json``), and
``code`` its exit code. A restarted server finds all jobs.
"""

import contextlib
import json
import os
import re
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uavcover.errors import InputError
from uavcover.extras.app.workspace import OWN_FOLDER
from uavcover.run.provenance import is_running, process_of

_ID = re.compile(r"[0-9]{10,14}-[0-9a-f]{8}")
_MOST_EVENT_BYTES = 1 << 20
_START_S = 60.0
KEPT = 60
"""Ended jobs whose folders stay."""


@dataclass(frozen=True, slots=True)
class Job:
    """One command."""

    folder: Path  # where its files are
    kind: str  # which command it is
    arguments: tuple[str, ...]  # its command line, without ``uavcover``
    run: str  # the run folder that it works on, relative to the page's folder; empty without one

    @property
    def id(self) -> str:
        """Its name."""
        return self.folder.name

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs, -1 where its process is gone and left none."""
        with contextlib.suppress(OSError, ValueError):
            return int((self.folder / "code").read_text(encoding="ascii"))
        return None if self._is_starting() or is_running(self._process()) else self._code_of_the_dead()

    def _is_starting(self) -> bool:
        """Whether its process has not written its number yet."""
        try:
            age_s = time.time() - (self.folder / "job.json").stat().st_mtime
        except OSError:
            return False
        return age_s < _START_S and not (self.folder / "process.json").exists()

    def _code_of_the_dead(self) -> int:
        with contextlib.suppress(OSError, ValueError):  # it may have ended between the two looks
            return int((self.folder / "code").read_text(encoding="ascii"))
        return -1

    def _process(self) -> Any:
        try:
            return json.loads((self.folder / "process.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def events(self, begin: int = 0) -> tuple[list[dict[str, Any]], int]:
        """Events from a byte of the file on, and the byte after the last whole one.

        A line that is no event of ours, such as an error, becomes ``{"say": line}``.
        """
        try:
            with (self.folder / "events").open("rb") as file:
                file.seek(begin)
                raw = file.read(_MOST_EVENT_BYTES)
        except OSError:
            return [], begin
        whole = raw[: raw.rfind(b"\n") + 1]
        events = []
        for line in whole.decode("utf-8", errors="replace").splitlines():
            event: object = None
            with contextlib.suppress(ValueError):
                event = json.loads(line)
            events.append(event if isinstance(event, dict) else {"say": line})
        return events, begin + len(whole)

    def document(self, *, with_events: bool = True) -> dict[str, Any]:
        """Its state for the page."""
        code = self.code
        events, end = self.events() if with_events else ([], 0)
        result: Any = None
        if code is not None:
            with contextlib.suppress(OSError, ValueError):
                result = json.loads((self.folder / "result").read_text(encoding="utf-8"))
        return {
            "id": self.id, "kind": self.kind, "run": self.run, "code": code, "result": result, "end": end,
            "command": ["uavcover", *self.arguments], "events": [e for e in events if "progress" not in e] + events[-1:],
        }  # fmt: skip

    def signal(self, number: signal.Signals) -> bool:
        """Send its process a signal; False where it is gone."""
        process = self._process()
        if self.code is not None or not is_running(process):
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(process["pid"], number)
            return True
        return False


class Jobs:
    """The jobs of a folder.

    Args:
        root: the folder.
        program: runs a job whose folder is its last argument, and detaches itself (:func:`detach`).
    """

    def __init__(
        self, root: Path, *, program: Sequence[str] = (sys.executable, "-m", "uavcover.extras.app.jobs")
    ) -> None:
        self._root, self._program = root, tuple(program)
        self._folder = root / OWN_FOLDER / "jobs"

    def start(self, kind: str, arguments: Sequence[str], *, run: str = "") -> Job:
        """Start a command in the page's folder.

        Raises:
            InputError: another job works on the same run folder, or the folder cannot be written to.
        """
        if run and any(_overlap(job.run, run) and job.code is None for job in self.all()):
            raise InputError(f"{run}: another command is using this run folder; wait until it ends, or stop it")
        folder = self._folder / f"{time.time_ns() // 1_000_000}-{secrets.token_hex(4)}"
        words = (*arguments, "--json", "--events")
        job = Job(folder, kind, words, run)
        try:
            folder.mkdir(parents=True)
            about = {"kind": kind, "arguments": job.arguments, "run": run}
            (folder / "job.json").write_text(json.dumps(about), encoding="utf-8")
            with (folder / "events").open("wb") as events, (folder / "result").open("wb") as result:
                subprocess.run(
                    [*self._program, str(folder)], cwd=self._root, stdin=subprocess.DEVNULL, stdout=result, stderr=events,
                    start_new_session=True, check=True, timeout=_START_S,
                )  # fmt: skip
        except (OSError, subprocess.SubprocessError) as error:
            raise InputError(f"{' '.join(words)}: cannot start the command ({error})") from error
        self._forget_old()
        return job

    def all(self) -> list[Job]:
        """Every job, the latest first."""
        try:
            names = sorted((path.name for path in self._folder.iterdir() if _ID.fullmatch(path.name)), reverse=True)
        except OSError:
            return []
        return [job for name in names if (job := self._read(name)) is not None]

    def get(self, name: str) -> Job:
        """A job by its id. Raises InputError: there is none."""
        job = self._read(name) if _ID.fullmatch(name) else None
        if job is None:
            raise InputError(f"{name!r}: no such job; reload the page")
        return job

    def _read(self, name: str) -> Job | None:
        folder = self._folder / name
        try:
            about = json.loads((folder / "job.json").read_text(encoding="utf-8"))
            return Job(folder, str(about["kind"]), tuple(map(str, about["arguments"])), str(about["run"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def _forget_old(self) -> None:
        for job in self.all()[KEPT:]:
            if job.code is not None:
                for path in job.folder.iterdir():
                    path.unlink(missing_ok=True)
                with contextlib.suppress(OSError):
                    job.folder.rmdir()


def _overlap(one: str, other: str) -> bool:
    """Whether two run folders are the same, or one is inside the other."""
    return f"{one}/".startswith(f"{other}/") or (bool(one) and f"{other}/".startswith(f"{one}/"))


def detach(folder: Path) -> None:
    """Continue as a detached process, whose number is kept in the folder; the caller's process ends."""
    if pid := os.fork():
        (folder / "process.json").write_text(json.dumps(process_of(pid)), encoding="utf-8")
        os._exit(0)


def main() -> None:
    """The process of a job: runs its command and keeps its exit code."""
    folder = Path(sys.argv[1])
    detach(folder)
    sys.argv = ["uavcover", *json.loads((folder / "job.json").read_text(encoding="utf-8"))["arguments"]]
    from uavcover.__main__ import main as uavcover

    code: object = 2
    try:
        uavcover()
    except SystemExit as end:
        code = end.code
    finally:
        half = folder / "code.half"
        half.write_text(str(code if isinstance(code, int) else 0 if code is None else 1), encoding="ascii")
        os.replace(half, folder / "code")


if __name__ == "__main__":
    main()
