"""A benchmark's folder: one JSON file for each run, written whole, so that a killed benchmark goes on where it was."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from uavcover.errors import InputError, OutputError
from uavcover.run_folder import RunFolder, json_text, write_text

_SETTINGS = "settings.json"


class KeptRuns:
    """Where the runs of a benchmark are kept: ``runs/KEY.json``; a key has slashes, as ``R2-ray/imodbo/1``.

    Attributes:
        path: the folder.
        settings: what all its runs have in common; runs of different settings are not mixed.
    """

    def __init__(self, path: Path, settings: Mapping[str, str | int | float]) -> None:
        self.path = path
        self.settings = dict(settings)

    @contextmanager
    def reserved(self) -> Iterator[None]:
        """Make the folder, or take up one made with the same settings, and keep other processes out of it.

        Raises:
            InputError: its runs were made with other settings.
            OutputError: it has files but is none of ours, or cannot be written to.
        """
        with RunFolder(self.path).reserved([], force=False):
            file = self.path / _SETTINGS
            if file.exists():
                before = _document(file)
                if before != self.settings:
                    raise InputError(
                        f"{self.path}: its runs were made with {_told(before)}, not with {_told(self.settings)}; "
                        "use another folder"
                    )
            elif any(self.path.iterdir()):
                raise OutputError(f"{self.path}: has files, but no {_SETTINGS} of a benchmark; use another folder")
            else:
                write_text(file, json_text(self.settings))
            yield

    def file(self, key: str) -> Path:
        """Where a run is."""
        return self.path / "runs" / f"{key}.json"

    def has(self, key: str) -> bool:
        """Whether a run is done."""
        return self.file(key).is_file()

    def done(self) -> list[str]:
        """Every run that is done, sorted by its parts, numbers by their size."""
        root = self.path / "runs"
        found = (path.relative_to(root).with_suffix("") for path in root.rglob("*.json"))
        return sorted((key.as_posix() for key in found), key=_by_parts)

    def write(self, key: str, document: dict[str, Any]) -> None:
        """Write a run, whole or not at all; numbers unrounded.

        Raises:
            OutputError: it cannot be written.
        """
        path = self.file(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path.parent}: cannot be made ({error.strerror})") from error
        write_text(path, json_text(document))

    def read(self, key: str) -> dict[str, Any]:
        """A run as it was written.

        Raises:
            InputError: the file cannot be read.
        """
        return _document(self.file(key))


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise ValueError("expected an object")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it and give the same command again") from error
    return document


def _by_parts(key: str) -> list[tuple[int, int, str]]:
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in key.split("/")]


def _told(settings: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in settings.items())
