"""The error of this package."""

from uavcover.errors import InputError


class RecordingError(InputError):
    """A recording that cannot be written as asked, read, or shown."""
