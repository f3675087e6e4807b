"""What ``run.json`` says of a flight from its first second on, and what that means once its program is gone.

A flight that goes on stands there as ``flying``, with the process that follows it. When that process ends without another word,
as by ``kill -9`` or a power cut, the flight is ``interrupted``: every command that looks at the run says so, and writes it down.
"""

import contextlib
import os
from pathlib import Path
from typing import Any, Final

from uavcover.errors import InputError, OutputError
from uavcover.run.folder import RunFolder
from uavcover.vehicle.outcome import FlightOutcome

FLYING: Final = "flying"
INTERRUPTED: Final = "interrupted"
_KEY, _PROCESS = "flight", "process"
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_STARTED_FIELD = 19
"""Of those behind the name of the program in ``/proc/PID/stat``: when it was started, in ticks since the machine was."""


def forget(run: RunFolder) -> None:
    """No older flight's ending stands there any more; errors as ``note_flying``."""
    _note(run, None)


def note_flying(run: RunFolder) -> None:
    """From here on the run speaks of this flight, and of no older one.

    Raises:
        InputError, OutputError: ``run.json`` cannot be read or written.
    """
    _note(run, {"ending": FLYING, _PROCESS: _own_process()})


def note_outcome(run: RunFolder, outcome: FlightOutcome) -> None:
    """How the flight ended; errors as ``note_flying``."""
    _note(run, outcome.as_json())


def note_interrupted(run: RunFolder) -> None:
    """The flight is not followed any more, and how it goes on is not known; errors as ``note_flying``."""
    _note(run, {"ending": INTERRUPTED, "vehicle_now": "not known: it was not followed to the end"})


def settled_ending(run: RunFolder) -> str | None:
    """How the flight of a run ended, by its name; ``flying`` while it goes on, None where there was none.

    A flight whose program is gone is ``interrupted``; that is written down where it can be.
    """
    flight = _read(run)
    if flight is None:
        return None
    if flight.get("ending") == FLYING and not _is_there(flight.get(_PROCESS)):
        with contextlib.suppress(InputError, OutputError):  # a folder that may only be read is looked at, too
            note_interrupted(run)
        return INTERRUPTED
    ending = flight.get("ending")
    return ending if isinstance(ending, str) else None


def _read(run: RunFolder) -> dict[str, Any] | None:
    try:
        flight = run.read_json("run.json", made_by="uavcover plan").get(_KEY)
    except InputError:
        return None
    return flight if isinstance(flight, dict) else None


def _note(run: RunFolder, flight: dict[str, Any] | None) -> None:
    document = {k: v for k, v in run.read_json("run.json", made_by="uavcover plan").items() if k != _KEY}
    run.write_json("run.json", document if flight is None else {**document, _KEY: flight})


def _own_process() -> dict[str, Any]:
    return {"pid": os.getpid(), "started": _started(os.getpid()), "boot_id": _boot_id()}


def _is_there(process: object) -> bool:
    """Whether the process that follows a flight runs, as far as it can be told; another one that has its number is not it."""
    if not isinstance(process, dict) or not isinstance(pid := process.get("pid"), int) or pid <= 0:
        return False
    if process.get("boot_id") != _boot_id():
        return False
    if (started := process.get("started")) is not None:
        return bool(_started(pid) == started)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it is somebody else's
        return True
    return True


def _boot_id() -> str | None:
    """Tells one start of the machine from the next; None where the operating system has no such thing."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return None


def _started(pid: int) -> int | None:
    """When a process was started, in ticks; None when it is not there, or where the operating system does not tell."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        fields = stat.rpartition(")")[2].split()
        return None if fields[0] in ("Z", "X") else int(fields[_STARTED_FIELD])
    except (OSError, IndexError, ValueError):
        return None
