"""Frames over a serial line: a telemetry radio, or a flight controller's USB. Needs pyserial (the extra ``serial``)."""

import errno
import os
from types import ModuleType
from typing import Any

from mission_io.errors import LinkError, MisuseError
from mission_io.links.base import DEFAULT_BAUD
from mission_io.links.stream import ChannelLink

_ADVICE = {
    errno.ENOENT: "is it plugged in?",
    errno.EACCES: "may this user use serial ports (often the group dialout)?",
    errno.EPERM: "may this user use serial ports (often the group dialout)?",
    errno.EAGAIN: "another program has it open",
    errno.EBUSY: "another program has it open",
}


class SerialChannel:
    """A non-blocking serial port.

    pyserial opens and configures it. Reading and writing is done here, since pyserial's ``write`` spins while a port accepts
    nothing, and its ``read`` discards data when the port disappears.
    """

    def __init__(self, port: Any, name: str) -> None:
        self._port, self._name = port, name

    @property
    def name(self) -> str:
        """``serial port DEVICE``."""
        return self._name

    def fileno(self) -> int:
        """Its file descriptor; -1 when closed."""
        return int(self._port.fileno()) if self._port.is_open else -1

    def read(self, size: int) -> bytes:
        """The bytes available now, possibly none."""
        try:
            data = os.read(self.fileno(), size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone("nothing is there any more")
        return data

    def write(self, data: bytes) -> int:
        """Send what can be sent at once; returns the number of bytes."""
        try:
            return os.write(self.fileno(), data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _gone(self, why: str) -> LinkError:
        if not self._port.is_open:
            return LinkError(f"the link to {self._name} is closed")
        self._port.close()
        return LinkError(f"{self._name} has gone: {why}; open the link again when it is back")


def open_serial(device: str, baud: int = DEFAULT_BAUD) -> ChannelLink:
    """Open a link over a serial port, for exclusive use.

    Raises:
        MisuseError: pyserial is not installed.
        LinkError: no such port, or it cannot be opened with this baud rate.
    """
    serial = _pyserial()
    try:
        port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError, OverflowError) as error:  # SerialException is an OSError
        number = getattr(error, "errno", None)
        why = os.strerror(number) if number else str(error)
        advice = f"; {_ADVICE[number]}" if number in _ADVICE else ""
        raise LinkError(f"cannot open the serial port {device} at {baud} baud: {why}{advice}") from None
    return ChannelLink(SerialChannel(port, f"serial port {device}"))


def _pyserial() -> ModuleType:
    try:
        import serial
    except ImportError:
        raise MisuseError("serial links need pyserial; pip install pyserial") from None
    module: ModuleType = serial
    return module
