"""Judges MAVProxy's client by the conformance suite's cases, over UDP of this machine, with a MAVProxy of its own for each case.

python scripts/conformance_mavproxy.py --mavproxy "PYTHON mavproxy.py" -o conformance_mavproxy.json [--at-once 4] [CASE ...]

MAVProxy is not installed by this project: ``pip install --no-deps MAVProxy`` in an environment of its own that has pymavlink.
Each case is begun by one command line (wp load, fence list, ...). What it tells its user is what it prints: of an upload the
vehicle's last ACK, of a download that the items were saved. It can neither cancel nor send an empty list: "not asked".
"""

import argparse
import json
import re
import shlex
import shutil
import subprocess
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from mission_io.conformance.__main__ import serve
from mission_io.conformance.client_cases import CLIENT_CASES
from mission_io.conformance.evidence import ClientCase, Operation
from mission_io.conformance.fake_vehicle import LONGEST_S, FakeVehicle
from mission_io.conformance.samples import sample
from mission_io.links.opening import UdpLink
from mission_io.model.items import MissionType
from scripts.options import file_to_write, one_of

_ITEMS: Final = 7
_READY_S, _BEGIN_S, _POLL_S = 60.0, 20.0, 0.1
_COMMANDS: Final = {MissionType.MISSION: "wp", MissionType.FENCE: "fence", MissionType.RALLY: "rally"}
_ACK: Final = re.compile(r"Got MISSION_ACK: \S+: (\S+)")


def mission_file(folder: Path, mission_type: MissionType) -> Path:
    """A list as MAVProxy loads it: rows of QGC WPL 110, without a home row for fences and rally points."""
    path = folder / "list.txt"
    rows = ["QGC WPL 110"]
    for seq, item in enumerate(sample(mission_type, _ITEMS, first=30)):
        numbers = (*item.params, item.lat_deg, item.lon_deg, item.alt_m)
        rows.append("\t".join(map(str, (seq, 0, int(item.frame), int(item.command), *numbers, 1))))
    path.write_text("\n".join(rows) + "\n")
    return path


def command_of(case: ClientCase, folder: Path) -> str | None:
    """What is typed; none where MAVProxy has no such thing."""
    mission_type = case.mission_type or MissionType.MISSION
    name = _COMMANDS[mission_type]
    match case.operation:
        case Operation.UPLOAD:
            return f"{name} load {mission_file(folder, mission_type)}"
        case Operation.DOWNLOAD:
            return f"{name} list"
        case Operation.CLEAR:
            return f"{name} clear"
        case Operation.SET_CURRENT:
            return "wp set 2"
        case _:
            return None


def told_by(operation: Operation, printed: str) -> bool | None:
    """Whether the user was told of a success, of a failure, or of nothing."""
    if operation is Operation.DOWNLOAD:
        return True if "Saved " in printed else None
    acks = _ACK.findall(printed)
    if acks:
        return bool(acks[-1].endswith("ACCEPTED"))
    return True if operation is Operation.UPLOAD and re.search(r"Loaded \d+ .* in [\d.]+s", printed) else None


def judged(case: ClientCase, mavproxy: list[str]) -> dict[str, Any]:
    """One case, with a vehicle and a MAVProxy of its own."""
    row: dict[str, Any] = {
        "case": case.name,
        "result": "not asked",
        "seen": "nothing was sent",
        "took_s": 0.0,
        "told": None,
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        typed = command_of(case, folder)
        if typed is None:
            return row | {"seen": "it has no such operation"}
        link, vehicle, stop = UdpLink.listening(), FakeVehicle([case]), threading.Event()
        thread = threading.Thread(target=serve, args=(link, vehicle), kwargs={"stopped": stop.is_set}, daemon=True)
        thread.start()
        options = [
            f"--master=udpout:127.0.0.1:{link.local_port}", "--nowait", "--state-basedir", name,
            "--default-modules=wp,fence,rally",
        ]  # fmt: skip
        printed: list[str] = []
        process = subprocess.Popen(
            [*mavproxy, *options],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        reader = threading.Thread(target=lambda: printed.extend(iter(lambda: process.stdout.read(1), "")), daemon=True)
        reader.start()

        def until(holds: Any, longest_s: float) -> None:
            end_s = time.monotonic() + longest_s
            while not holds() and time.monotonic() < end_s and process.poll() is None:
                time.sleep(_POLL_S)

        until(lambda: "Detected vehicle" in "".join(printed), _READY_S)
        before = len(printed)
        process.stdin.write(typed + "\n")
        process.stdin.flush()
        until(lambda: vehicle.busy or vehicle.results, _BEGIN_S)

        def tell() -> bool:
            told = told_by(case.operation, "".join(printed[before:]))
            if told is not None:
                vehicle.told(told)
                row["told"] = told
            return bool(vehicle.results)

        until(tell, LONGEST_S + 10.0)
        row["printed"] = "".join(printed[before:])[-600:]
        process.stdin.close()
        process.kill()
        process.wait()
        stop.set()
        thread.join(10.0)
        link.close()
    for result in vehicle.results:
        row |= {"result": result.outcome.value, "seen": result.seen, "took_s": round(result.took_s, 2)}
    return row


def main() -> None:
    """Judge the cases, and write them as they come."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mavproxy", required=True)
    parser.add_argument("-o", "--output", type=file_to_write, required=True)
    parser.add_argument("--at-once", type=int, default=4)
    parser.add_argument("case", nargs="*", type=one_of([case.name for case in CLIENT_CASES]))
    parsed = parser.parse_args()
    command = shlex.split(parsed.mavproxy)
    if not command or shutil.which(command[0]) is None:
        parser.error(f"--mavproxy {parsed.mavproxy}: no such command; give the one that starts MAVProxy")
    cases = [case for case in CLIENT_CASES if not parsed.case or case.name in parsed.case]
    rows: list[dict[str, Any]] = []
    with ThreadPoolExecutor(parsed.at_once) as executor:
        for row in executor.map(lambda case: judged(case, command), cases):
            rows.append(row)
            print(f"{row['case']:<32} {row['result']:<14} {row['seen']}", flush=True)
            parsed.output.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
