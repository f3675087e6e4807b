"""What the capabilities know of a vehicle that runs."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from mission_io.model.items import GeoPoint


@dataclass(frozen=True, slots=True)
class RunningVehicle:
    """A vehicle that was started.

    Attributes:
        url: where a ground station finds it.
        second_url: where a second one does.
        home: where it stands.
        version: what flies it, for the record.
        log_files: the logs that its autopilot has written by now.
        inject: begins one of the mock vehicle's faults; None for a simulated autopilot.
    """

    url: str
    second_url: str
    home: GeoPoint
    version: str
    log_files: Callable[[], tuple[Path, ...]]
    inject: Callable[[str], None] | None = None


@dataclass(frozen=True, slots=True)
class StartRequest:
    """How a vehicle is to be started.

    Attributes:
        folder: of its own, empty; where it runs and leaves what it writes.
        home: where it is to stand.
        speed: vehicle seconds per second.
        parameters: to be set before it flies, by the autopilot's names.
    """

    folder: Path
    home: GeoPoint
    speed: float
    parameters: Mapping[str, float]


Start = Callable[[StartRequest], AbstractContextManager[RunningVehicle]]
"""Starts a vehicle, and ends it when the context is left."""
