"""The errors of uavcover. Each is one line that says what is wrong, where, and what to do about it."""

from typing import Any, Final

INTERRUPTED: Final = 130
"""What the command line ends with when the user interrupted it."""


class UavcoverError(Exception):
    """Root of every error that uavcover raises on purpose; ``exit_code`` is what the command line ends with."""

    exit_code = 1

    def details(self) -> dict[str, Any]:
        """What a program may want to know beside the line; goes into the object under ``--json``."""
        return {}


class InputError(UavcoverError):
    """Bad usage or bad input: a file, a value, a place."""

    exit_code = 2


class ScenarioError(InputError):
    """A scenario that cannot be understood; the message starts with the path of the key."""


class TerrainError(InputError):
    """Elevation data that cannot be used for what is asked of it."""


class NoElevationError(TerrainError):
    """Elevation data without a height at a position; ``extent`` says in words how far the data extends."""

    def __init__(self, message: str, *, extent: str) -> None:
        self.extent = extent
        super().__init__(message)


class NoTileNearError(TerrainError):
    """Several elevation tiles, and none of them is near the area."""


class TrackError(InputError):
    """A flown track that cannot be read."""


class OutputError(InputError):
    """A place that cannot be written to, or a file that would be overwritten."""


class OptimizerError(UavcoverError):
    """Wrong shapes, bounds or values given to an optimizer."""

    exit_code = 2


class VehicleError(UavcoverError):
    """The vehicle or the link failed."""

    exit_code = 3


class InfeasibleError(UavcoverError):
    """No plan keeps the hard limits; the message says which limit, where and by how much."""

    exit_code = 4


class StageOver(BaseException):
    """A stage has gone on for too long after its time, or after a request to stop; no error, so that no handler takes it."""
