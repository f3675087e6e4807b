"""A link that MAVSDK and our own ears share: nobody needs a second connection to the vehicle."""

from mission_io.clock import Clock
from mission_io.link import Link
from uavcover.mavsdk_client.session import MavsdkSession

_SLICE_S = 0.002
"""How long what MAVSDK wants to be sent may wait."""


class SharedLink:
    """A :class:`~mission_io.link.Link` that tells MAVSDK what arrives, and sends what MAVSDK says while it listens.

    Args:
        link: carries the datagrams.
        session: the MAVSDK instance on it.
    """

    def __init__(self, link: Link, session: MavsdkSession) -> None:
        self._link, self._session = link, session

    @property
    def clock(self) -> Clock:
        """The clock of the link inside."""
        return self._link.clock

    def send(self, data: bytes) -> None:
        """Send one datagram of ours."""
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, which MAVSDK has then too, or None after ``timeout_s`` seconds."""
        deadline = self.clock.now() + timeout_s
        while True:
            for datagram in self._session.take_outgoing():
                self._link.send(datagram)
            left_s = deadline - self.clock.now()
            data = self._link.receive(min(max(0.0, left_s), _SLICE_S))
            if data is not None:
                self._session.receive(data)
            if data is not None or left_s <= 0.0:
                return data

    def close(self) -> None:
        """End MAVSDK and close the link inside; closing twice is fine."""
        self._session.close()
        self._link.close()
