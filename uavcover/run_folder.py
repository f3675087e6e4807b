"""The run folder: names of its files, and writing them so that nothing is lost or half there."""

import contextlib
import json
import math
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from uavcover.errors import InputError, OutputError

SCHEMA_VERSION = 1


class RunFolder:
    """A folder with everything about one run; see docs/files.md.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def __str__(self) -> str:
        return str(self.path)

    def file(self, name: str) -> Path:
        """Path of one of its files."""
        return self.path / name

    def existing(self, name: str, *, made_by: str) -> Path:
        """Path of a file that must be there.

        Raises:
            InputError: it is not; says which command makes it.
        """
        path = self.file(name)
        if not path.is_file():
            raise InputError(f"{self.path}: has no {name}; it is made by: {made_by}")
        return path

    def prepare(self, names: Iterable[str], *, force: bool) -> None:
        """Make the folder and see that the files can be written.

        Raises:
            OutputError: a file is there already and ``force`` was not said, or the folder cannot be made.
        """
        there = [name for name in names if self.file(name).exists()]
        if there and not force:
            raise OutputError(f"{self.path}: {', '.join(there)} would be overwritten; use --force, or another folder")
        with _writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
            # A folder that cannot be written to is better known before an hour of planning than after.
            with tempfile.TemporaryFile(dir=self.path):
                pass

    def write_text(self, name: str, text: str) -> Path:
        """Write a file whole or not at all.

        Raises:
            OutputError: it cannot be written; the file that was there before is untouched.
        """
        path = self.file(name)
        write_text(path, text)
        return path

    def write_json(self, name: str, document: dict[str, Any]) -> Path:
        """Write a JSON file whole or not at all; numbers unrounded, NaN as null."""
        return self.write_text(name, json_text(document))

    def read_json(self, name: str, *, made_by: str) -> dict[str, Any]:
        """Read a JSON file of the folder.

        Raises:
            InputError: it is missing, or not JSON.
        """
        path = self.existing(name, made_by=made_by)
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: cannot be read as JSON ({error}); make it again with: {made_by}") from error
        if not isinstance(document, dict):
            raise InputError(f"{path}: is not a JSON object; make it again with: {made_by}")
        return document


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises:
        OutputError: it cannot be written; the file that was there before is untouched.
    """
    with _writing(path):
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(temporary, 0o666 & ~umask)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


def json_text(document: dict[str, Any]) -> str:
    """JSON for people and programs: two spaces, numbers unrounded, NaN and infinity as null."""
    return json.dumps(_without_nan(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _without_nan(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return value


@contextlib.contextmanager
def _writing(path: Path) -> Any:
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise OutputError(f"{path}: cannot be written ({reason}); free some space or choose another folder") from error
