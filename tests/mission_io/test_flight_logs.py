import random

import pytest

from mission_io.client.flight_logs import download_flight_log, list_flight_logs
from mission_io.errors import TransferSilentError, VehicleSilentError
from mission_io.links.simulated import Conditions
from mission_io.wire.messages import LogData, LogEntry, LogRequestData, LogRequestEnd, LogRequestList, Received
from tests.mission_io.vehicle import VehiclePeer, connected

LOGS = {3: random.Random(3).randbytes(200_001), 4: b"", 7: random.Random(7).randbytes(90)}


class KeepsLogs(VehiclePeer):
    """Has the logs of LOGS; answers nothing about bytes beyond ``gives_out_at``."""

    gives_out_at = 1 << 40
    ended = 0

    def on_message(self, received: Received, now: float) -> None:
        del now
        match received.message:
            case LogRequestList():
                self.outbox += [LogEntry(n, len(LOGS), max(LOGS), 0, len(LOGS[n])) for n in LOGS]
            case LogRequestData() as asked:
                for at in range(asked.offset_bytes, asked.offset_bytes + asked.count, 90):
                    part = LOGS[asked.log_id][at : min(at + 90, asked.offset_bytes + asked.count)]
                    if at < self.gives_out_at:
                        self.outbox.append(LogData(asked.log_id, at, len(part), (*part, *(0,) * (90 - len(part)))))
            case LogRequestEnd():
                self.ended += 1


def test_the_logs_are_listed_by_their_numbers() -> None:
    entries = list_flight_logs(connected(KeepsLogs()))
    assert [(entry.log_id, entry.size_bytes) for entry in entries] == [(3, 200_001), (4, 0), (7, 90)]


def test_a_vehicle_without_logs_has_an_empty_list() -> None:
    class Empty(KeepsLogs):
        def on_message(self, received: Received, now: float) -> None:
            del now
            if isinstance(received.message, LogRequestList):
                self.outbox.append(LogEntry(0, 0, 0, 0, 0))

    assert list_flight_logs(connected(Empty())) == ()


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_every_byte_of_a_log_comes_across(loss: float) -> None:
    peer = KeepsLogs()
    client = connected(peer, conditions=Conditions(loss=loss))
    told: list[tuple[int, int]] = []
    for entry in list_flight_logs(client):
        content = download_flight_log(client, entry, progress=lambda done, total: told.append((done, total)))
        assert content == LOGS[entry.log_id]
    assert told[-2] == (200_001, 200_001)
    assert peer.ended > 0


def test_a_vehicle_that_falls_silent_is_said_with_how_much_had_come() -> None:
    peer = KeepsLogs()
    peer.gives_out_at = 60_000
    client = connected(peer)
    entry = list_flight_logs(client)[0]
    with pytest.raises(TransferSilentError, match=r"log 3: vehicle 1 fell silent after 46080 of 200001 bytes"):
        download_flight_log(client, entry, timeout_s=3.0)


def test_a_list_that_does_not_come_is_an_error() -> None:
    with pytest.raises(VehicleSilentError, match="its list of logs within 2 s"):
        list_flight_logs(connected(VehiclePeer()), timeout_s=2.0)
