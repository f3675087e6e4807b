"""The errors of uavcover. Each is one line with the problem, its place and the remedy."""

from typing import Any, Final

INTERRUPTED: Final = 130
"""Exit code of a command that the user interrupted."""


class UavcoverError(Exception):
    """Root of every error that uavcover raises on purpose; ``exit_code`` is that of the command line."""

    exit_code = 1

    def details(self) -> dict[str, Any]:
        """Additional data for programs, in the object of ``--json``."""
        return {}


class InputError(UavcoverError):
    """Bad usage or bad input: a file, a value, a place."""

    exit_code = 2


class ScenarioError(InputError):
    """A scenario that cannot be understood; the message starts with the path of the key."""


class TerrainError(InputError):
    """Elevation data that cannot be used for its purpose."""


class NoElevationError(TerrainError):
    """Elevation data without a height at a position; ``extent`` describes the data's extent."""

    def __init__(self, message: str, *, extent: str) -> None:
        self.extent = extent
        super().__init__(message)


class NoTileNearError(TerrainError):
    """Several elevation tiles, and none of them is near the area."""


class TrackError(InputError):
    """A flown track that cannot be read."""


class OutputError(InputError):
    """A path that cannot be written, or a file that would be overwritten."""


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
    """A stage exceeds its time, or continues after a request to stop; not an error, so that no handler takes it."""
