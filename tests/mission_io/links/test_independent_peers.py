"""pymavlink's own links at the other end of ours: TCP both ways and UDP, plain and signed."""

import time
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega

from mission_io.client.connection import Connection
from mission_io.links.datagrams import Link, UdpLink
from mission_io.links.opening import open_link
from mission_io.links.stream import TcpListeningLink
from mission_io.wire.messages import Heartbeat, MissionRequestList
from mission_io.wire.signing import SigningKey
from tests.mission_io.links.streams import PATIENCE_S

KEY = SigningKey.from_passphrase("correct horse")


def tcp_to_us() -> tuple[Link, Any]:
    link = TcpListeningLink()
    return link, mavutil.mavlink_connection(
        f"tcp:127.0.0.1:{link.local_port}", source_system=1, dialect="ardupilotmega"
    )


def tcp_to_them() -> tuple[Link, Any]:
    theirs = mavutil.mavlink_connection("tcpin:127.0.0.1:0", source_system=1, dialect="ardupilotmega")
    link = open_link(f"tcp:127.0.0.1:{theirs.listen.getsockname()[1]}")
    theirs.recv(1)  # accepts
    return link, theirs


def udp_to_us() -> tuple[Link, Any]:
    link = UdpLink.listening()
    return link, mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{link.local_port}", source_system=1, dialect="ardupilotmega"
    )


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("connect", [tcp_to_us, tcp_to_them, udp_to_us])
def test_pymavlink_and_we_hear_each_other(connect: Any, signed: bool) -> None:
    link, theirs = connect()
    theirs.mav = ardupilotmega.MAVLink(theirs, 1, 1)
    theirs.mav.robust_parsing = True
    with Connection(link) as ours:
        if signed:
            ours.sign_with(KEY)
            theirs.setup_signing(KEY.secret, sign_outgoing=True)
        theirs.mav.heartbeat_send(2, 12, 0, 0, 3)
        assert ours.wait_for_vehicle(PATIENCE_S).system_id == 1
        ours.send(Heartbeat(8, 6))
        ours.send(MissionRequestList(1, 1))
        deadline, heard = time.monotonic() + PATIENCE_S, None
        while heard is None and time.monotonic() < deadline:
            heard = theirs.recv_match(type="MISSION_REQUEST_LIST", blocking=False)
        assert heard is not None
        assert (heard.get_srcSystem(), heard.get_srcComponent(), bool(heard.get_signed())) == (255, 190, signed)
        assert ours.statistics.garbage_bytes == ours.statistics.refused == 0
    theirs.close()
