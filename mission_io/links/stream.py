"""Frames over byte streams, TCP connections and serial ports: finds them, and sends each of them whole or not at all."""

import errno
import logging
import os
import select
import socket
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Any, ClassVar, Final, Protocol

from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import DEFAULT_BAUD, DEFAULT_HOST, Clock, Closing, MonotonicClock, port_of
from mission_io.wire.codec import Framer, FramingCounts

QUIET_S: Final = 0.5
"""Silence after which an apparent start of a long frame is given up if frames wait after it."""

SEND_BUFFER_BYTES: Final = 65_536
"""What waits to be sent to a peer that does not take it; frames that find no room are lost."""


class OpenChannel(ABC):
    """Something open that bytes go through, without waiting.

    Attributes:
        name: Name of the stream, for messages to people.
        end: Meaning of the end of the stream.
    """

    end: ClassVar[str]

    def __init__(self, name: str) -> None:
        self.name = name

    @abstractmethod
    def fileno(self) -> int:
        """Its number, to wait for it; negative when it is closed."""

    @abstractmethod
    def receive(self, size: int) -> bytes:
        """Bytes that have arrived; none at the end. Raises OSError: it has gone, BlockingIOError: nothing has arrived."""

    @abstractmethod
    def send(self, data: bytes) -> int:
        """Send without waiting; return the number of sent bytes. Raises OSError as ``receive``."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it; closing twice is fine."""

    def read(self, size: int) -> bytes:
        """Bytes that have arrived; empty without any. Raises LinkError when the other end has gone."""
        try:
            data = self.receive(size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone(self.end)
        return data

    def write(self, data: bytes) -> int:
        """Send the bytes that can be sent at once; returns their number. Raises LinkError when the other end has gone."""
        try:
            return self.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None

    def _gone(self, why: str) -> LinkError:
        if self.fileno() < 0:
            return LinkError(f"the link to {self.name} is closed")
        self.close()
        return LinkError(f"the connection to {self.name} was lost: {why}; open the link again when it is available")


class FramedChannel:
    """Frames in and out of one channel."""

    def __init__(self, channel: OpenChannel, clock: Clock) -> None:
        self.channel = channel
        self._clock = clock
        self._framer = Framer()
        self._waiting = bytearray()
        self._last_byte_s = clock.now()
        self.dropped_frames = 0

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame."""
        return self._framer.counts

    @property
    def has_to_send(self) -> bool:
        """Whether something waits until the channel takes it."""
        return bool(self._waiting)

    @property
    def quiet_at_s(self) -> float | None:
        """When to call ``frames_when_quiet`` if nothing arrives until then; None for not at all."""
        return self._last_byte_s + QUIET_S if self._framer.unfinished_bytes else None

    def take(self) -> list[bytes]:
        """The frames that are complete now; reads once."""
        data = self.channel.read(65_536)
        if data:
            self._last_byte_s = self._clock.now()
        return [frame.data for frame in self._framer.feed(data)]

    def frames_when_quiet(self) -> list[bytes]:
        """The frames behind one that does not end, when it has been quiet for ``QUIET_S``."""
        due = self.quiet_at_s
        if due is None or self._clock.now() < due:
            return []
        self._last_byte_s = self._clock.now()
        return [frame.data for frame in self._framer.end_if_frames_wait()]

    def put(self, frame: bytes) -> None:
        """Send a frame, part of it now and the rest later; without room for it, none of it."""
        self.flush()
        if len(self._waiting) + len(frame) > SEND_BUFFER_BYTES:
            self.dropped_frames += 1
            return
        self._waiting += frame
        self.flush()

    def flush(self) -> None:
        """Send waiting bytes, as far as possible without waiting."""
        while self._waiting:
            sent = self.channel.write(bytes(self._waiting))
            if sent == 0:
                return
            del self._waiting[:sent]


class ChannelLink(Closing):
    """A link over one channel for as long as that lasts; a context manager.

    When the other end goes away that is one LinkError; what had arrived before is delivered first.
    """

    def __init__(self, channel: OpenChannel, clock: Clock | None = None) -> None:
        self._clock = clock if clock is not None else MonotonicClock()
        self._framed = FramedChannel(channel, self._clock)
        self._frames: deque[bytes] = deque()

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame."""
        return self._framed.framing

    @property
    def dropped_frames(self) -> int:
        """Frames that were not sent because the other end took nothing for too long."""
        return self._framed.dropped_frames

    def send(self, data: bytes) -> None:
        """Send a frame. Raises LinkError: the other end has gone, or the link is closed."""
        self._framed.put(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next frame, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the other end has gone, or the link is closed.
        """
        framed = self._framed
        deadline = self._clock.now() + timeout_s
        while not self._frames:
            wake = deadline if framed.quiet_at_s is None else min(deadline, framed.quiet_at_s)
            channel = framed.channel
            readable, writable = wait_for([channel], [channel] if framed.has_to_send else [], wake - self._clock.now())
            if writable:
                framed.flush()
            if readable:
                self._frames.extend(framed.take())
            else:
                self._frames.extend(framed.frames_when_quiet())
                if not self._frames and self._clock.now() >= deadline:
                    return None
        return self._frames.popleft()

    def close(self) -> None:
        """Let go of the channel; closing twice is fine."""
        self._framed.channel.close()


class _Open(Protocol):
    def fileno(self) -> int: ...


def wait_for(readers: Sequence[_Open], writers: Iterable[_Open], timeout_s: float) -> tuple[list[_Open], list[_Open]]:
    """Those that can be read and those that can be written, after at most ``timeout_s`` seconds.

    Raises:
        LinkError: one of them is closed.
    """
    try:
        readable, writable, _ = select.select(readers, list(writers), [], max(0.0, timeout_s))
    except (OSError, ValueError):
        raise LinkError("the link is closed") from None
    return readable, writable


CONNECT_TIMEOUT_S: Final = 5.0
MOST_PEERS: Final = 16

_log = logging.getLogger(__name__)


class TcpChannel(OpenChannel):
    """One TCP connection, without waiting."""

    end = "the other side closed the connection"

    def __init__(self, sock: socket.socket, name: str) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # a mission item must not wait for the next one
        super().__init__(name)
        self._socket = sock

    def fileno(self) -> int:
        """The number of its socket."""
        return self._socket.fileno()

    def receive(self, size: int) -> bytes:
        """Bytes that have arrived, as the socket has it."""
        return self._socket.recv(size)

    def send(self, data: bytes) -> int:
        """Send, as the socket does it."""
        return self._socket.send(data)

    def close(self) -> None:
        """Let go of it."""
        self._socket.close()


def connect_tcp(host: str, port: int, *, timeout_s: float = CONNECT_TIMEOUT_S) -> ChannelLink:
    """A link to an address that listens on TCP.

    Raises:
        LinkError: no listener there, or no answer within ``timeout_s`` seconds.
    """
    try:
        sock = socket.create_connection((host, port), timeout=timeout_s)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise LinkError(
            f"cannot connect to TCP {host}:{port}: {why}; is the vehicle switched on and listening at this address?"
        ) from None
    return ChannelLink(TcpChannel(sock, f"TCP {host}:{port}"))


class TcpListeningLink(Closing):
    """Everybody who connects to a TCP port, as one link; a context manager.

    What is sent goes to all of them, what they send comes in the order in which it arrives. One that connects or goes
    away is a line in the log and no error: the next one may come. Messages without a connection are lost.
    """

    def __init__(self, host: str = DEFAULT_HOST, port: int = 0) -> None:
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        except (OSError, UnicodeError) as error:
            raise LinkError(f"cannot find the host {host!r}: {error}") from None
        self._listener = socket.socket(family, kind)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind(address)
            self._listener.listen(MOST_PEERS)
        except OSError as error:
            self._listener.close()
            raise LinkError(f"cannot listen on TCP {host}:{port}: {error.strerror}; is the port in use?") from None
        self._listener.setblocking(False)
        self._clock = MonotonicClock()
        self._peers: dict[int, FramedChannel] = {}
        self._frames: deque[bytes] = deque()
        self._framing_before = FramingCounts()

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def local_port(self) -> int:
        """The TCP port that was bound."""
        return port_of(self._listener)

    @property
    def peers(self) -> tuple[str, ...]:
        """The names of all connected peers."""
        return tuple(peer.channel.name for peer in self._peers.values())

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame, from all connections so far."""
        return sum((peer.framing for peer in self._peers.values()), self._framing_before)

    def send(self, data: bytes) -> None:
        """Send a frame to everybody who is connected. Raises LinkError: the link is closed."""
        self._serve(0.0)
        for peer in list(self._peers.values()):
            try:
                peer.put(data)
            except LinkError as error:
                self._drop(peer, error)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next frame of any connection, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the link is closed.
        """
        deadline = self._clock.now() + timeout_s
        while not self._frames:
            quiet = [peer.quiet_at_s for peer in self._peers.values() if peer.quiet_at_s is not None]
            idle = self._serve(min([deadline, *quiet]) - self._clock.now())
            if idle and not self._frames and self._clock.now() >= deadline:
                return None
        return self._frames.popleft()

    def close(self) -> None:
        """Close the port and all connections; closing twice has no effect."""
        self._listener.close()
        for peer in self._peers.values():
            peer.channel.close()

    def _serve(self, timeout_s: float) -> bool:
        """Wait once, then accept, read and write what there is; whether there was nothing."""
        channels = {number: peer.channel for number, peer in self._peers.items()}
        writers = [peer.channel for peer in self._peers.values() if peer.has_to_send]
        readable, writable = wait_for([self._listener, *channels.values()], writers, timeout_s)
        for number, channel in channels.items():
            peer = self._peers[number]
            try:
                if channel in writable:
                    peer.flush()
                self._frames.extend(peer.take() if channel in readable else peer.frames_when_quiet())
            except LinkError as error:
                self._drop(peer, error)
        if self._listener in readable:
            self._accept()
        return not readable

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError:
            return  # it has gone again already
        channel = TcpChannel(sock, f"TCP {address[0]}:{address[1]}")
        if len(self._peers) >= MOST_PEERS:
            _log.warning("rejected %s, because %d clients are already connected", channel.name, MOST_PEERS)
            channel.close()
            return
        _log.info("%s has connected", channel.name)
        self._peers[channel.fileno()] = FramedChannel(channel, self._clock)

    def _drop(self, peer: FramedChannel, why: LinkError) -> None:
        _log.warning("%s", why)
        self._framing_before += peer.framing
        self._peers = {number: other for number, other in self._peers.items() if other is not peer}
        peer.channel.close()


_ADVICE = {
    errno.ENOENT: "is the device connected?",
    errno.EACCES: "does this user have access to serial ports (often through the group dialout)?",
    errno.EPERM: "does this user have access to serial ports (often through the group dialout)?",
    errno.EAGAIN: "another program uses the device",
    errno.EBUSY: "another program uses the device",
}


class SerialChannel(OpenChannel):
    """A non-blocking serial port.

    pyserial opens and configures it. Reading and writing is done here, since pyserial's ``write`` spins while a port accepts
    nothing, and its ``read`` discards data when the port disappears.
    """

    end = "the device was disconnected"

    def __init__(self, port: Any, name: str) -> None:
        super().__init__(name)
        self._port = port

    def fileno(self) -> int:
        """Its file descriptor; -1 when closed."""
        return int(self._port.fileno()) if self._port.is_open else -1

    def receive(self, size: int) -> bytes:
        """Bytes that have arrived, as the operating system has it."""
        return os.read(self.fileno(), size)

    def send(self, data: bytes) -> int:
        """Send, as the operating system does it."""
        return os.write(self.fileno(), data)

    def close(self) -> None:
        """Close the port."""
        self._port.close()


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
        raise MisuseError("serial links require pyserial; install it with: pip install pyserial") from None
    module: ModuleType = serial
    return module
