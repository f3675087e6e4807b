"""A group of changes to the files of one folder: all are made, or none if the process is killed.

New files are first written beside the others, into a folder of their own. Then a journal lists the renames that put them in place
and what they replace away; from that moment the group counts as done. Who opens the folder next, and finds a journal, finishes
what it lists. An error between two renames, such as a directory in the way, undoes those that were made.
"""

import contextlib
import errno
import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from uavcover.errors import OutputError

JOURNAL = ".uavcover-journal.json"
_STAGED, _PART = ".uavcover-staged-", ".uavcover-part-"
_AWAY, _INSTALL = "away", "place"

Step = tuple[str, str, str]
"""Kind, from where and to where, both relative to the folder. What goes away never meets a file where it goes."""


def write_file(path: Path, content: bytes) -> None:
    """Write one file whole or not at all.

    Raises:
        OutputError: it cannot be written; the old content is untouched.
    """
    temporary = None
    try:
        with writing(path):
            path.parent.mkdir(exist_ok=True)
            new = path.parent / f"{_PART}{secrets.token_hex(8)}"
            handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
            temporary = new
            _fill(handle, content)
            os.replace(new, path)
            temporary = None
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def change_together(
    folder: Path, contents: Mapping[str, bytes], *, removed: Iterable[str] = (), moved: Mapping[str, str] | None = None
) -> None:
    """Write, remove and move files of a folder, all or none.

    Args:
        folder: exists.
        contents: new files by their path in it; what is there under these names is replaced.
        removed: files that go, where they are there.
        moved: files and folders that get another name, which is free, before the new ones are put in place.

    Raises:
        OutputError: one of it cannot be done; then all is as it was.
    """
    moved = dict(moved or {})
    gone = [name for name in removed if name not in contents and os.path.lexists(folder / name)]
    for name in (*contents, *gone):
        if name not in moved and (folder / name).is_dir():
            raise OutputError(
                f"{folder / name}: this is a directory, but a file must be written here; move or rename it"
            )
    if not gone and not moved and len(contents) <= 1:
        for name, content in contents.items():
            write_file(folder / name, content)
        return
    made: list[Path] = []
    staged = None
    try:
        for name in (*contents, *moved.values()):
            with writing(folder / name):
                made += _make_parents(folder, folder / name)
        with writing(folder):
            staged = Path(tempfile.mkdtemp(dir=folder, prefix=_STAGED))
            steps = _stage(folder, staged, contents, gone, moved)
            _write_journal(folder, staged, steps, back=False)
    except BaseException:
        if staged is not None and not (folder / JOURNAL).exists():
            shutil.rmtree(staged, ignore_errors=True)
            for path in reversed(made):
                with contextlib.suppress(OSError):
                    path.rmdir()
        raise
    try:
        _forward(folder, steps)
        _finish(folder, staged)
    except OSError as error:
        with writing(folder):
            _write_journal(folder, staged, steps, back=True)
            _back(folder, steps)
            _finish(folder, staged)
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()
        where = error.filename2 or error.filename or folder
        raise OutputError(f"{where}: the file cannot be written ({error.strerror}); nothing was changed") from error


def is_unsettled(folder: Path) -> bool:
    """Whether a group was begun in a folder and not finished."""
    return (folder / JOURNAL).exists()


def settle(folder: Path) -> None:
    """Finish or undo the group of a process that ended, and remove unused and half-written files.

    No other process may work in the folder.

    Raises:
        OutputError: it cannot be done.
    """
    if is_unsettled(folder):
        try:
            journal = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
            staged = folder / journal["staged"]
            steps: list[Step] = [(kind, source, target) for kind, source, target in journal["steps"]]
            (_back if journal["back"] else _forward)(folder, steps)
            _finish(folder, staged)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(
                f"{folder}: replacing files was interrupted and cannot be completed ({error}); correct the cause, or "
                f"see {JOURNAL} in this folder"
            ) from error
    for left in folder.glob(f"{_STAGED}*"):
        shutil.rmtree(left, ignore_errors=True)
    remove_half_written(folder.glob("*"))


def remove_half_written(paths: Iterable[Path]) -> None:
    """Remove, of these files, those that ``write_file`` was writing when its process was killed."""
    for path in paths:
        if path.name.startswith(_PART):
            with contextlib.suppress(OSError):
                path.unlink()


def _make_parents(folder: Path, path: Path) -> list[Path]:
    missing = []
    parent = path.parent
    while parent != folder and not parent.exists():
        missing.append(parent)
        parent = parent.parent
    path.parent.mkdir(parents=True, exist_ok=True)
    return missing[::-1]


def _stage(
    folder: Path, staged: Path, contents: Mapping[str, bytes], gone: Iterable[str], moved: Mapping[str, str]
) -> list[Step]:
    """Write the new files into the staging folder; the renames that are to be made."""
    away: list[Step] = []
    install: list[Step] = []
    for source, target in moved.items():
        if os.path.lexists(folder / target):
            raise FileExistsError(None, "a file with this name exists", str(folder / target))
        away.append((_AWAY, source, target))
    for number, (name, content) in enumerate(contents.items()):
        new = staged / f"new-{number}"
        _fill(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), content)
        install.append((_INSTALL, f"{staged.name}/{new.name}", name))
        if name not in moved and os.path.lexists(folder / name):
            away.append((_AWAY, name, f"{staged.name}/old-{number}"))
    for number, name in enumerate(gone):
        if name not in moved:
            away.append((_AWAY, name, f"{staged.name}/gone-{number}"))
    return away + install


def _forward(folder: Path, steps: Iterable[Step]) -> None:
    for kind, source, target in steps:
        begun, done = os.path.lexists(folder / source), os.path.lexists(folder / target)
        if kind == _AWAY and begun and not done:
            os.rename(folder / source, folder / target)
        elif kind == _INSTALL and begun:
            if done:
                raise FileExistsError(None, "a file or folder with this name exists", str(folder / target))
            (folder / target).parent.mkdir(parents=True, exist_ok=True)  # its folder may have gone away whole
            os.rename(folder / source, folder / target)


def _back(folder: Path, steps: Iterable[Step]) -> None:
    for kind, source, target in reversed(list(steps)):
        if kind == _INSTALL and not os.path.lexists(folder / source):
            os.rename(folder / target, folder / source)
        elif kind == _AWAY and os.path.lexists(folder / target):
            if (folder / source).is_dir():
                os.rmdir(folder / source)  # made for what was taken back
            elif os.path.lexists(folder / source):
                raise FileExistsError(None, "a file or folder with this name exists", str(folder / source))
            os.rename(folder / target, folder / source)


def _finish(folder: Path, staged: Path) -> None:
    (folder / JOURNAL).unlink(missing_ok=True)
    shutil.rmtree(staged, ignore_errors=True)


def _write_journal(folder: Path, staged: Path, steps: Iterable[Step], *, back: bool) -> None:
    document = {"staged": staged.name, "steps": list(steps), "back": back}
    new = staged / f"journal-{back}"
    _fill(os.open(new, os.O_WRONLY | os.O_CREAT, 0o666), json.dumps(document).encode())
    _sync_folder(staged)
    os.replace(new, folder / JOURNAL)
    _sync_folder(folder)


def _fill(handle: int, content: bytes) -> None:
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Names of files are on the disk too; a file system that cannot do it is no error."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Errors of the operating system in the words of uavcover. Raises OutputError: instead of any OSError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        advice = "free some space or choose another folder" if error.errno in NO_ROOM else "choose another folder"
        raise OutputError(f"{path}: the file cannot be written ({reason}); {advice}") from error


def numbered(out: Path, number: int) -> str:
    """Name of one of several files of an export."""
    return f"{out.stem}-{number}{out.suffix}"
