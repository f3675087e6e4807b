"""MAVLink messages about the logs that a vehicle keeps: it is asked for the list, and for their bytes."""

from dataclasses import dataclass

LOG_DATA_BYTES = 90
"""As many bytes of a log fit in one message."""


@dataclass(frozen=True, slots=True)
class LogRequestList:
    """Asks for the entries from number ``first`` to ``last``."""

    target_system: int
    target_component: int
    first: int = 0
    last: int = 65535


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One log of the vehicle.

    Attributes:
        log_id: Its number.
        log_count: How many logs there are; with 0 the rest means nothing.
        last_log_id: The highest number.
        time_unix_s: When it was begun; 0 when the vehicle did not know the time.
        size_bytes: Its size; 0 for a log that is being written, with some autopilots.
    """

    log_id: int
    log_count: int
    last_log_id: int
    time_unix_s: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class LogRequestData:
    """Asks for ``count`` bytes of a log from ``offset_bytes`` on."""

    target_system: int
    target_component: int
    log_id: int
    offset_bytes: int
    count: int


@dataclass(frozen=True, slots=True)
class LogData:
    """Bytes of a log: the first ``count`` of ``padded`` are from ``offset_bytes`` on; fewer than 90 mean its end."""

    log_id: int
    offset_bytes: int
    count: int
    padded: tuple[int, ...]

    @property
    def content(self) -> bytes:
        """The bytes that belong to the log."""
        return bytes(self.padded[: self.count])


@dataclass(frozen=True, slots=True)
class LogRequestEnd:
    """Says that no more is wanted, so that the vehicle may log again."""

    target_system: int
    target_component: int
