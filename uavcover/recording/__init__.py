"""Flight recordings for the rerun viewer: writing, reading, listing, showing. The only package that imports rerun.

Importing it loads rerun, which takes about a second, so commands import it only where they need it.
"""

from uavcover.recording.flight import RecordedEvent, VehicleState
from uavcover.recording.layout import RecordingError
from uavcover.recording.reader import RecordingRow, describe_recording, read_recorded_track
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
