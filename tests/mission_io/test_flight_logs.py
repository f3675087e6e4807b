import random
import re
from pathlib import Path

import pytest

from mission_io.client.files import FlightLogDownloads, list_flight_logs
from mission_io.errors import TransferCancelledError, TransferSilentError, VehicleSilentError
from mission_io.links.simulated import Conditions
from mission_io.wire.messages import Received
from mission_io.wire.telemetry_messages import LogData, LogEntry, LogRequestData, LogRequestEnd, LogRequestList
from tests.mission_io.vehicle import VehiclePeer, connected

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "vehicle_calls.md"
LOGS = {3: random.Random(3).randbytes(200_001), 4: b"", 7: random.Random(7).randbytes(90)}


class KeepsLogs(VehiclePeer):
    """Has the logs of LOGS; answers nothing about bytes beyond ``gives_out_at``."""

    gives_out_at = 1 << 40
    ended = 0

    def on_message(self, received: Received, *_: object) -> None:
        match received.message:
            case LogRequestList():
                self.outbox += [LogEntry(n, len(LOGS), max(LOGS), 0, len(LOGS[n])) for n in LOGS]
            case LogRequestData() as requested:
                for at in range(requested.offset_bytes, requested.offset_bytes + requested.count, 90):
                    part = LOGS[requested.log_id][at : min(at + 90, requested.offset_bytes + requested.count)]
                    if at < self.gives_out_at:
                        self.outbox.append(LogData(requested.log_id, at, len(part), (*part, *(0,) * (90 - len(part)))))
            case LogRequestEnd():
                self.ended += 1


def test_the_logs_are_listed_by_their_numbers() -> None:
    entries = list_flight_logs(connected(KeepsLogs()))
    assert [(entry.log_id, entry.size_bytes) for entry in entries] == [(3, 200_001), (4, 0), (7, 90)]


def test_a_vehicle_without_logs_has_an_empty_list() -> None:
    class Empty(KeepsLogs):
        def on_message(self, received: Received, *_: object) -> None:
            if isinstance(received.message, LogRequestList):
                self.outbox.append(LogEntry(0, 0, 0, 0, 0))

    assert list_flight_logs(connected(Empty())) == ()


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_every_byte_of_a_log_comes_across(loss: float) -> None:
    peer = KeepsLogs()
    client = connected(peer, conditions=Conditions(loss=loss))
    reported: list[tuple[int, int]] = []
    for entry in list_flight_logs(client):
        content = FlightLogDownloads(client).download(
            entry, progress=lambda done, total: reported.append((done, total))
        )
        assert content == LOGS[entry.log_id]
    assert (200_001, 200_001) in reported
    assert reported[-1] == (90, 90)
    assert peer.ended > 0


def test_a_vehicle_that_falls_silent_is_said_with_how_much_had_come() -> None:
    peer = KeepsLogs()
    peer.gives_out_at = 60_000
    client = connected(peer)
    entry = list_flight_logs(client)[0]
    with pytest.raises(TransferSilentError, match=r"log 3: vehicle 1 stopped answering after 60030 of 200001 bytes"):
        FlightLogDownloads(client, silent_s=3.0).download(entry)


def test_what_gave_up_goes_on_and_asks_for_nothing_twice() -> None:
    peer = KeepsLogs()
    peer.gives_out_at = 60_000
    client = connected(peer)
    entry = list_flight_logs(client)[0]
    downloads = FlightLogDownloads(client, silent_s=3.0)
    with pytest.raises(TransferSilentError):
        downloads.download(entry)
    with pytest.raises(TransferCancelledError, match="log 3: stopped after 60030 of 200001 bytes"):
        downloads.download(entry, stop=lambda: True)
    client.poll(0.1)
    peer.gives_out_at, heard = 1 << 40, len(peer.heard)
    assert downloads.download(entry) == LOGS[3]
    requested = [r.message for r in peer.heard[heard:] if isinstance(r.message, LogRequestData)]
    assert [(one.offset_bytes, one.count) for one in requested] == [(60_030, 139_971)]


@pytest.mark.parametrize("seed", range(5))
def test_only_what_got_lost_is_asked_for_again(seed: int) -> None:
    peer = KeepsLogs()
    client = connected(peer, seed=seed, conditions=Conditions(loss=0.2, duplication=0.1, delay_s=0.01))
    entry = next(entry for entry in list_flight_logs(client, timeout_s=60.0) if entry.log_id == 3)
    assert FlightLogDownloads(client).download(entry) == LOGS[3]
    requested = [r.message for r in peer.heard if isinstance(r.message, LogRequestData)]
    assert sum(one.count for one in requested) < 1.8 * len(LOGS[3])


def test_a_lost_entry_of_the_list_is_asked_for_by_its_number() -> None:
    class Forgets(KeepsLogs):
        def on_message(self, received: Received, *_: object) -> None:
            if isinstance(received.message, LogRequestList):
                first, last = received.message.first, received.message.last
                shown = [n for n in (5, 6, 7) if first <= n <= last and (first, n) != (0, 6)]
                self.outbox += [LogEntry(n, 3, 7, 0, 90) for n in shown]

    peer = Forgets()
    assert [entry.log_id for entry in list_flight_logs(connected(peer))] == [5, 6, 7]
    requested = [r.message for r in peer.heard if isinstance(r.message, LogRequestList)]
    assert (requested[-1].first, requested[-1].last) == (6, 6)


def test_bytes_of_strangers_and_short_pieces_are_not_taken() -> None:
    class Spoils(KeepsLogs):
        def on_message(self, received: Received, now: float) -> None:
            super().on_message(received, now)
            if isinstance(received.message, LogRequestData):
                self.outbox[:0] = [
                    LogData(3, 7, 90, (1,) * 90), LogData(3, 0, 10, (1,) * 90), LogData(3, 1 << 31, 90, (1,) * 90),
                ]  # fmt: skip

    client = connected(Spoils())
    entry = list_flight_logs(client)[0]
    assert FlightLogDownloads(client).download(entry) == LOGS[3]


def test_a_list_that_does_not_come_is_an_error() -> None:
    with pytest.raises(VehicleSilentError, match="its list of logs within 2 s"):
        list_flight_logs(connected(VehiclePeer()), timeout_s=2.0)


def test_the_example_of_the_page_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code = next(one for one in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if "flight_logs" in one)
    client = connected(KeepsLogs(), conditions=Conditions(loss=0.05))
    monkeypatch.setattr("mission_io.open_link", lambda _: client.link)
    exec(compile(code, str(PAGE), "exec"), {})
    assert capsys.readouterr().out == "log 3: 200001 bytes\nlog 4: 0 bytes\nlog 7: 90 bytes\n"
