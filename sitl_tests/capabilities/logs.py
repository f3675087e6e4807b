"""The log that the autopilot wrote of a flight, downloaded over MAVLink."""

import hashlib

from mission_io.client.files import FlightLogDownloads, list_flight_logs
from sitl_tests.case import Case, Finding, Stopwatch
from sitl_tests.errors import require
from sitl_tests.flying import take_off, wait_until_landed
from sitl_tests.matrix import WORKS
from sitl_tests.missions import route_mission
from sitl_tests.simulators.files import sha256

_SHORT_M = ((0.0, 10.0),)
_CLOSED_S = 30.0
"""ArduPilot goes on logging for 15 s after it was disarmed."""
_LIST_S = 20.0


def log_download(case: Case) -> Finding:
    """After a short flight the latest log is downloaded, and is the file that the autopilot wrote, byte for byte."""
    with case.station() as station:
        take_off(case, station, route_mission(case.vehicle.home, _SHORT_M, height_m=8.0))
        wait_until_landed(station)
        station.wait_s(_CLOSED_S)
        entries = [entry for entry in list_flight_logs(station.client, timeout_s=_LIST_S) if entry.size_bytes]
        if not entries:
            return Finding("none", "the vehicle says that it has no logs")
        latest = max(entries, key=lambda entry: entry.log_id)
        watch = Stopwatch()
        content = FlightLogDownloads(station.client).download(latest)
        took_s = watch.elapsed_s
    files = {sha256(path): path.name for path in case.vehicle.log_files()}
    name = files.get(hashlib.sha256(content).hexdigest())
    require(name is not None, f"{len(content)} bytes came, which are none of {sorted(files.values())}")
    return Finding(WORKS, f"{name}: {len(content) / 1e6:.2f} MB in {took_s:.1f} s, equal to the file")
