"""Two ground stations at one vehicle."""

from mission_io import messages as m
from mission_io.autopilots import wire_items
from mission_io.compare import compare_items
from mission_io.enums import MissionResult
from mission_io.items import MissionType
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.matrix import WORKS
from sitl_tests.missions import long_mission
from uavcover.mission_compiler import AUTOPILOTS

_ITEMS = 30
_ANSWER_S = 2.0


def second_station(case: Case) -> Finding:
    """A second station hears, is turned away in the middle of the first one's upload, and downloads what that gave."""
    autopilot = AUTOPILOTS[case.autopilot]
    wanted = wire_items(long_mission(case.vehicle.home, _ITEMS), autopilot)
    answers: list[str] = []
    with case.station() as first, case.second_station() as second:

        def interfere(across: int, total: int) -> None:
            if not answers and across >= total // 2:
                answers.append(_answer_to_count(second))

        first.client.upload(MissionType.MISSION, wanted, progress=interfere)
        held = second.client.download(MissionType.MISSION)
    wrong = [d for d in compare_items(wanted, held, autopilot) if not d.acceptable]
    require(bool(answers), "the upload had no middle")
    require(not wrong, f"the second station reads {wrong[:2]}")
    return Finding(WORKS, f"the second one is answered {answers[0]}, the first one's {len(held)} items are whole")


def _answer_to_count(station: Station) -> str:
    """What a station that wants to upload one item is answered.

    Raises:
        CheckFailedError: it was let in.
    """
    vehicle, own = station.client.vehicle, station.client.local
    station.client.send(m.MissionCount(vehicle.system_id, vehicle.component_id, 1))

    answers: list[m.MissionAck | m.MissionRequest | m.MissionRequestInt] = []

    def is_answer(received: m.Received) -> bool:
        match received.message:
            case m.MissionAck() | m.MissionRequest() | m.MissionRequestInt() as answer:
                if answer.target_system == own.system_id:
                    answers.append(answer)
        return bool(answers)

    station.client.wait_until(is_answer, timeout_s=_ANSWER_S, what="an answer to a second upload")
    if not isinstance(answers[0], m.MissionAck):
        raise CheckFailedError("the second station's upload was let in")
    return MissionResult(answers[0].result).name
