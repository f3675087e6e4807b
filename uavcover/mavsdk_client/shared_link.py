"""A link that MAVSDK and our own ears share: nobody needs a second connection to the vehicle."""

from mission_io.framing import Framer
from mission_io.link import Link
from mission_io.links.base import WrappingLink
from uavcover.mavsdk_client.session import MavsdkSession

_SLICE_S = 0.002
"""How long what MAVSDK wants to be sent may wait."""


class SharedLink(WrappingLink):
    """A :class:`~mission_io.link.Link` that tells MAVSDK what arrives, and sends what MAVSDK says while it listens.

    MAVSDK hears the vehicle's autopilot alone, from ``keep_to`` on: what a companion computer says with the same system id must
    answer none of its questions.

    Args:
        link: carries the datagrams.
        session: the MAVSDK instance on it.
    """

    def __init__(self, link: Link, session: MavsdkSession) -> None:
        super().__init__(link)
        self._session = session
        self._vehicle: tuple[int, int] | None = None

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Hear and speak to this sender's place only, and let MAVSDK hear this sender only."""
        super().keep_to(system_id, component_id)
        self._vehicle = (system_id, component_id)

    def let_go(self) -> None:
        """Hear everybody again; MAVSDK hears nobody until the vehicle is chosen."""
        super().let_go()
        self._vehicle = None

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
                self._session.receive(self._of_vehicle(data))
            if data is not None or left_s <= 0.0:
                return data

    def _of_vehicle(self, data: bytes) -> bytes:
        """The vehicle's own frames of a datagram."""
        framer = Framer()
        frames = [*framer.feed(data), *framer.end()]
        return b"".join(frame.data for frame in frames if (frame.system_id, frame.component_id) == self._vehicle)

    def close(self) -> None:
        """End MAVSDK and close the link inside; closing twice is fine."""
        self._session.close()
        self._link.close()
