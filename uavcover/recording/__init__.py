"""Flight recordings for the rerun viewer: writing, reading, listing, showing. The only package that imports rerun.

Its modules load rerun, which takes about a second, so commands import it only where they need it. The names exported here are
loaded when they are first used: who reads a recording does not load what writes one.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uavcover.recording.flight import RecordedEvent, VehicleState
    from uavcover.recording.layout import RecordingError, RecordingRow, describe_recording, read_recorded_track
    from uavcover.recording.viewer import open_viewer, screenshot
    from uavcover.recording.writer import write_recording

__all__ = [
    "RecordedEvent",
    "RecordingError",
    "RecordingRow",
    "VehicleState",
    "describe_recording",
    "open_viewer",
    "read_recorded_track",
    "screenshot",
    "write_recording",
]

_PLACES = {
    "uavcover.recording.flight": ("RecordedEvent", "VehicleState"),
    "uavcover.recording.layout": ("RecordingError", "RecordingRow", "describe_recording", "read_recorded_track"),
    "uavcover.recording.viewer": ("open_viewer", "screenshot"),
    "uavcover.recording.writer": ("write_recording",),
}


def __getattr__(name: str) -> Any:
    """The exported names, each loaded with what it needs when it is first used."""
    for module, names in _PLACES.items():
        if name in names:
            value = getattr(import_module(module), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
