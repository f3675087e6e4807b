import csv
import signal
import socket
import sys
from pathlib import Path

import pytest

from mission_io.client.client import Client
from mission_io.links.opening import open_link
from mission_io.wire.telemetry_messages import SysStatus
from tests.cli.conftest import WATCHDOG_S, Cli, mock_vehicle, started, wait_for_line
from uavcover.mock.faults import FaultKind


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_tells_its_port_and_ends_when_told(number: signal.Signals) -> None:
    with mock_vehicle("-q") as (port, process):
        assert port > 0
        process.send_signal(number)
        out, err = process.communicate(timeout=WATCHDOG_S)
    assert (process.returncode, out, err) == (0, "", "")


HOLDER = """
import signal
from uavcover.cli.demo import mock_process
with mock_process("jacksboro", "ardupilot", 1.0, 0) as url:
    print(url, flush=True)
    signal.pause()
"""


def test_the_vehicle_of_a_program_that_is_killed_ends_too() -> None:
    with started([sys.executable, "-c", HOLDER]) as holder:
        url = wait_for_line(holder, "udpout://")
        with Client(open_link(url.strip())) as client:
            client.wait_for_vehicle()
            holder.kill()
            while client.heartbeat_age_s < 3.0:  # it sends one a second; the watchdog of a test ends this
                client.poll(0.5)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", int(url.rpartition(":")[2])))


def test_takes_faults_errors_and_a_log_of_the_truth(tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    with mock_vehicle(
        "-q", "--speed", "20", "--fault", "heartbeat-loss:0.5@boot+60s", "--gps-noise", "1", "--endurance", "900",
        "--truth", truth,
    ) as (port, process):  # fmt: skip
        with Client(open_link(f"udpout://127.0.0.1:{port}")) as client:
            client.wait_for_vehicle()
            assert client.request_message(SysStatus).battery_remaining_percent == 100
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=WATCHDOG_S)
    rows = list(csv.DictReader(truth.read_text().splitlines()))
    assert len(rows) > 5
    assert any(abs(float(row["east_error_m"])) > 0.01 for row in rows)


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (("--listen", "tcp://127.0.0.1:5760"), "udpin://HOST:PORT"),
        (("--listen", "nonsense"), "nonsense"),
        (("--listen", "udpin://127.0.0.1:0", "--home", "here"), "--home"),
        (("--listen", "udpin://127.0.0.1:0", "--home", "95,0,0"), "--home"),
        (("--listen", "udpin://127.0.0.1:0", "--speed", "0"), "speed"),
        (("--listen", "udpin://127.0.0.1:0", "--loss", "1"), "loss"),
        (("--listen", "udpin://127.0.0.1:0", "--autopilot", "dji"), "--autopilot"),
        (("--listen", "udpin://127.0.0.1:0", "--behaviour", "rude"), "must be quick or observed, not 'rude'"),
        (("--listen", "udpin://127.0.0.1:0", "--gps-noise", "-1"), "must not be negative"),
        (("--listen", "udpin://127.0.0.1:0", "--endurance", "0"), "endurance_s"),
        (("--listen", "udpin://127.0.0.1:0", "--truth", "/no/such/place.csv"), "cannot be written"),
        (("--listen", "udpin://127.0.0.1:0", "--fault", "engine-fire"), "use one of heartbeat-loss"),
        (("--listen", "udpin://127.0.0.1:0", "--scenario", "paper-R2"), "defines no home on Earth"),
    ],
)
def test_bad_usage(cli: Cli, arguments: tuple[str, ...], telling: str) -> None:
    assert telling in cli("mock-vehicle", *arguments, code=2).error


def test_port_that_is_taken(cli: Cli) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        ended = cli("mock-vehicle", "--listen", f"udpin://127.0.0.1:{taken.getsockname()[1]}")
    assert ended.code == 3
    assert "is the port in use?" in ended.error


def test_help_names_every_fault(cli: Cli) -> None:
    shown = "".join(cli("mock-vehicle", "--help").out.split())  # a name may be broken at its hyphen
    assert [kind.value for kind in FaultKind if kind.value not in shown] == []
