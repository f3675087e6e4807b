"""Judges MAVSDK's client by the conformance suite's cases, over UDP of this machine, one case after the other.

python scripts/conformance_mavsdk.py -o conformance_mavsdk.json [CASE ...]

What a case is about is begun once; what the client tells its user is judged with what it sends. Cases that it cannot begin (it
clears only missions) are "not asked".
"""

import argparse
import json
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import mavsdk
from mavsdk.plugins import mission_raw

from mission_io.conformance.__main__ import serve
from mission_io.conformance.client_cases import CLIENT_CASES
from mission_io.conformance.evidence import ClientCase, Operation
from mission_io.conformance.fake_vehicle import LONGEST_S, FakeVehicle
from mission_io.conformance.samples import sample
from mission_io.links.opening import UdpLink
from mission_io.model.items import MissionType
from mission_io.wire.mission_items import message_from_item
from scripts.options import file_to_write, one_of

_SETTLE_S: Final = 0.5
_CANCEL_AFTER_S: Final = 1.2


def raw_items(mission_type: MissionType, count: int) -> list[Any]:
    """A list as MAVSDK takes it."""
    items = []
    for seq, item in enumerate(sample(mission_type, count, first=30)):
        m = message_from_item(item, seq, mission_type=mission_type, target_system=1, target_component=1)
        items.append(
            mission_raw.MissionItem(
                seq, m.frame, m.command, m.current, m.autocontinue, *m.params, m.x, m.y, m.z, int(mission_type)
            )
        )
    return items


def cancelled(begin: Callable[[Callable[..., None]], None], cancel: Callable[[], None]) -> None:
    """Begin something, cancel it, and raise what came of it unless it was a success."""
    ended, results = threading.Event(), []

    def done(*result: Any) -> None:
        results.append(str(result[0]))
        ended.set()

    begin(done)
    time.sleep(_CANCEL_AFTER_S)
    cancel()
    if not ended.wait(20.0) or "SUCCESS" not in results[0].upper():
        raise RuntimeError(results[0] if results else "no answer")


def begun(raw: Any, case: ClientCase) -> bool:
    """Begin what a case is about; False when MAVSDK has no such thing."""
    t = case.mission_type or MissionType.MISSION
    uploads = {
        MissionType.MISSION: raw.upload_mission,
        MissionType.FENCE: raw.upload_geofence,
        MissionType.RALLY: raw.upload_rally_points,
    }
    downloads = {
        MissionType.MISSION: raw.download_mission,
        MissionType.FENCE: raw.download_geofence,
        MissionType.RALLY: raw.download_rallypoints,
    }
    match case.operation:
        case Operation.UPLOAD:
            uploads[t](raw_items(t, 7))
        case Operation.EMPTY:
            uploads[t]([])
        case Operation.DOWNLOAD:
            downloads[t]()
        case Operation.CANCEL_UPLOAD:
            cancelled(lambda done: raw.upload_mission_async(raw_items(t, 7), done), raw.cancel_mission_upload)
        case Operation.CANCEL_DOWNLOAD:
            cancelled(raw.download_mission_async, raw.cancel_mission_download)
        case Operation.SET_CURRENT:
            raw.set_current_mission_item(2)
        case Operation.CLEAR:
            if t is not MissionType.MISSION:
                return False
            raw.clear_mission()
    return True


def judged(case: ClientCase) -> dict[str, Any]:
    """One case, with a vehicle and a MAVSDK of its own."""
    link, vehicle, stop = UdpLink.listening(), FakeVehicle([case]), threading.Event()
    thread = threading.Thread(target=serve, args=(link, vehicle), kwargs={"stopped": stop.is_set}, daemon=True)
    thread.start()
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    ground.add_any_connection(f"udpout://127.0.0.1:{link.local_port}")
    system = ground.first_autopilot(30.0)
    raw = mission_raw.MissionRaw(system)
    time.sleep(_SETTLE_S)
    told, error = True, ""
    try:
        if not begun(raw, case):
            told, error = False, "it has no such operation"
    except Exception as raised:  # whatever it raises is its way to tell of a failure
        told, error = False, str(raised)
    vehicle.told(told)
    thread.join(LONGEST_S + 10.0 if vehicle.busy else _SETTLE_S)
    stop.set()
    thread.join(10.0)
    raw.destroy()
    ground.destroy()
    link.close()
    row = {
        "case": case.name,
        "result": "not asked",
        "seen": "nothing was sent",
        "took_s": 0.0,
        "told": told,
        "error": error,
    }
    for result in vehicle.results:
        row |= {"result": result.outcome.value, "seen": result.seen, "took_s": round(result.took_s, 2)}
    return row


def main() -> None:
    """Judge the cases, and write them as they come."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=file_to_write, required=True)
    parser.add_argument("case", nargs="*", type=one_of([case.name for case in CLIENT_CASES]))
    parsed = parser.parse_args()
    mavsdk.log_subscribe(lambda *_: True)
    rows: list[dict[str, Any]] = []
    for case in CLIENT_CASES:
        if not parsed.case or case.name in parsed.case:
            rows.append(judged(case))
            print(f"{case.name:<32} {rows[-1]['result']:<14} {rows[-1]['seen']}", flush=True)
            parsed.output.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
