"""Cases for a vehicle whose upload is stopped, disturbed, or cannot be: cancel, errors, second stations, wrong addresses."""

from dataclasses import replace
from functools import partial
from typing import Final

from mission_io.conformance.case import LackingError, ProtocolCase, check, for_each_list
from mission_io.conformance.guide import Section
from mission_io.conformance.probe import REQUESTS, Probe, described, seq_of
from mission_io.conformance.samples import LIST_NAMES, sample
from mission_io.conformance.tuning import PROBE
from mission_io.conformance.upload_cases import accepted, begin_three
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionType
from mission_io.wire.messages import Heartbeat, MissionAck, MissionRequestInt

_MISSION: Final = MissionType.MISSION


def stopped_by(result: MissionResult, t: MissionType, p: Probe) -> str:
    """The station answers a request with an error: the vehicle stops, and the old list stays."""
    old = sample(t, 7)
    p.hold(t, old)
    begin_three(p, t)
    p.send(p.ack(result, t))
    p.quiet(0.5)
    late = [m for m in p.quiet(PROBE.stops_s) if isinstance(m, REQUESTS)]
    check(not late, f"{len(late)} more requests after ACK {result.name}")
    p.check_held(t, old, f"the old list after ACK {result.name}")
    return "stopped, old list unchanged"


def bad_item(p: Probe) -> str:
    """An item that cannot be: an error, and the old list stays."""
    old = sample(_MISSION, 7)
    p.hold(_MISSION, old)
    begin_three(p, _MISSION)
    p.send(replace(p.item(sample(_MISSION, 5, first=PROBE.new_items), 3), frame=PROBE.unknown_frame))
    answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    if isinstance(answer, REQUESTS) and seq_of(answer) == 4:
        raise LackingError(f"it accepts an item in frame {PROBE.unknown_frame}")
    check(
        isinstance(answer, MissionAck) and answer.result, f"an item in frame {PROBE.unknown_frame}: {described(answer)}"
    )
    said = described(answer)
    on = [m for m in p.quiet(PROBE.stops_s) if isinstance(m, REQUESTS)]
    check(not on, f"{said}, and then it requested item {seq_of(on[0]) if on else 0} again")
    p.check_held(_MISSION, old, f"the old list after {said}")
    return f"{said}, old list unchanged"


def too_many(p: Probe) -> str:
    """More items than any vehicle stores."""
    old = sample(_MISSION, 4)
    p.hold(_MISSION, old)
    p.forget()
    answer = p.ask(p.count(65535), _MISSION)
    check(answer is not None, "COUNT 65535 was not answered")
    check(not (isinstance(answer, MissionAck) and answer.result == MissionResult.ACCEPTED), "accepted without an item")
    if isinstance(answer, REQUESTS):
        p.send(p.ack(MissionResult.OPERATION_CANCELLED))
    p.rest()
    p.check_held(_MISSION, old, f"the old list after COUNT 65535 ({described(answer)})")
    return f"{described(answer)}, old list unchanged"


def empty(t: MissionType, p: Probe) -> str:
    """COUNT 0 empties the list."""
    p.hold(t, sample(t, 4))
    p.forget()
    answer = p.ask(p.count(0, t), t)
    check(isinstance(answer, MissionAck), f"COUNT 0 was answered with {described(answer)}")
    if isinstance(answer, MissionAck):
        accepted(p, answer)
    p.check_held(t, (), "after COUNT 0")
    return "accepted, list empty"


def _beat_as_other(p: Probe) -> None:
    p.send(Heartbeat(autopilot=8, vehicle_type=6, system_status=4), as_other=True)


def second_upload(p: Probe) -> str:
    """Another station announces an upload in the middle of one."""
    new = sample(_MISSION, 4, first=PROBE.new_items)
    _beat_as_other(p)
    p.begin_upload(4, _MISSION)
    p.send(p.item(new, 0))
    check(seq_of(p.answer(_MISSION)) == 1, "item 0 was not followed by the request of item 1")
    p.send(p.count(9), as_other=True)
    to_other = p.hear(
        lambda m: getattr(m, "target_system", 0) == p.other.system_id, PROBE.answer_s / 2.0, any_target=True
    )
    check(
        not isinstance(to_other, REQUESTS),
        "the vehicle requested items of the second station in the middle of the upload",
    )
    ack = p.finish_upload(new, _MISSION, first=1, wait_s=2.0 * PROBE.answer_s)
    accepted(p, ack)
    p.check_held(_MISSION, new, "after a second station announced an upload")
    return f"the second station got {described(to_other)}; the first one's list is there"


def foreign_items(p: Probe) -> str:
    """Another station's items do not get into the list."""
    new, foreign = sample(_MISSION, 4, first=PROBE.new_items), sample(_MISSION, 4, first=90)
    _beat_as_other(p)
    p.begin_upload(4, _MISSION)
    for seq in range(4):
        p.send(p.item(foreign, seq), as_other=True)
        p.send(p.item(new, seq))
    ack = p.answer(_MISSION, 2.0 * PROBE.answer_s, (MissionAck,))
    check(isinstance(ack, MissionAck), "no ACK")
    if isinstance(ack, MissionAck):
        accepted(p, ack)
    p.quiet(1.0)
    p.check_held(_MISSION, new, "after another station sent items")
    return "they were ignored"


def other_list(p: Probe) -> str:
    """An item for another list does not get into this one."""
    new = sample(_MISSION, 3, first=PROBE.new_items)
    stray = sample(MissionType.RALLY, 1)
    p.begin_upload(3, _MISSION)
    p.send(p.item(stray, 0, MissionType.RALLY))
    p.quiet(0.3)
    accepted(p, p.finish_upload(new, _MISSION))
    p.check_held(_MISSION, new, "after an item for the rally points")
    return "it was ignored"


def other_target(p: Probe) -> str:
    """Messages to another system get no answer, and change nothing."""
    old = sample(_MISSION, 4)
    p.hold(_MISSION, old)
    p.forget()
    p.send(replace(p.count(2), target_system=PROBE.absent_system))
    p.send(replace(p.count(2), target_system=PROBE.absent_system, target_component=0))
    said = p.quiet(2.0)
    check(not said, f"COUNT for system {PROBE.absent_system} was answered with {described(said[0]) if said else ''}")
    p.check_held(_MISSION, old, f"the list after COUNT for system {PROBE.absent_system}")
    return "no answer"


def strange_type(p: Probe) -> str:
    """A list that does not exist: an error, and nothing is changed."""
    old = sample(_MISSION, 4)
    p.hold(_MISSION, old)
    p.forget()
    p.send(p.count(2, PROBE.strange_type))
    said = p.quiet(2.0)
    asked = [m for m in said if isinstance(m, REQUESTS)]
    check(
        not asked,
        f"COUNT of mission_type {PROBE.strange_type}: requested items of type "
        f"{getattr(asked[0], 'mission_type', 0) if asked else 0}",
    )
    p.check_held(_MISSION, old, f"the mission after COUNT of mission_type {PROBE.strange_type}")
    return f"answered with {described(said[0] if said else None)}"


def nonsense_when_idle(p: Probe) -> str:
    """Requests, acknowledgements and items out of nowhere."""
    old = sample(_MISSION, 4)
    p.hold(_MISSION, old)
    new = sample(_MISSION, 4, first=PROBE.new_items)
    p.forget()
    for result in (MissionResult.ACCEPTED, MissionResult.ERROR, MissionResult.OPERATION_CANCELLED):
        p.send(p.ack(result))
    p.send(MissionRequestInt(*p.to, 40000))
    p.send(p.item(new, 1))
    p.send(p.item(new, 3))
    said = sorted({described(m) for m in p.quiet(2.0)})
    p.rest()
    p.check_held(_MISSION, old, f"the list after stray messages (answers: {', '.join(said) or 'none'})")
    return f"list unchanged; answers: {', '.join(said) or 'none'}"


def independent(p: Probe) -> str:
    """The three lists are kept apart."""
    lists = {t: sample(t, 4, first=10 * int(t)) for t in MissionType}
    kept = [t for t in MissionType if t is _MISSION or p.reads_list(t)]
    if len(kept) == 1:
        raise LackingError("it has only a mission")
    for t in kept:
        p.hold(t, lists[t])
    p.hold(_MISSION, sample(_MISSION, 6, first=PROBE.new_items))
    for t in kept[1:]:
        p.check_held(t, lists[t], f"the {LIST_NAMES[t]} after another mission")
    return f"{', '.join(LIST_NAMES[t] for t in kept)} kept apart"


_STOPPING = (
    MissionResult.ERROR,
    MissionResult.UNSUPPORTED,
    MissionResult.INVALID,
    MissionResult.DENIED,
)

REFUSAL_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (
    *for_each_list(
        "upload-cancelled", "a request is answered OPERATION_CANCELLED: both sides go idle, the old list stays",
        Section.CANCEL, partial(stopped_by, MissionResult.OPERATION_CANCELLED),
        ("ReceiveIncomingMissionCanBeCancelled", "UploadMissionCanBeCancelled"),
    ),
    *(
        ProtocolCase(
            f"upload-stopped-by-{result.name}", "any request may be answered with an error; that ends the operation",
            Section.ERRORS, partial(stopped_by, result, _MISSION), ("SendOutgoingMissionNackAreHandled",),
        )
        for result in _STOPPING
    ),
    ProtocolCase("upload-bad-item", "an error cancels the operation and leaves the mission unchanged", Section.UPLOAD, bad_item),
    ProtocolCase("upload-too-many", "COUNT may be answered NO_SPACE; the mission stays", Section.UPLOAD, too_many),
    *for_each_list(
        "upload-empty", "COUNT 0 has the effect of a clear", Section.UPLOAD, empty,
        ("UploadMissionDoesComplainAboutNoItems", "ReceiveIncomingMissionEmptyList"),
    ),
    ProtocolCase("upload-second-station", "the mission is replaced by one whole upload", Section.UPLOAD, second_upload),
    ProtocolCase("upload-foreign-items", "the same", Section.UPLOAD, foreign_items),
    ProtocolCase(
        "upload-other-list", "each list has its own operations, separated by mission_type", Section.TYPES, other_list,
        ("UploadMissionDoesComplainAboutInconsistentMissionTypesInItems",),
    ),
    ProtocolCase("upload-other-target", "a message is for the system that it names", Section.ROUTING, other_target),
    ProtocolCase("upload-strange-type", "mission_type is mission, fence or rally", Section.TYPES, strange_type),
    ProtocolCase(
        "upload-nonsense", "idle, it may answer with an error", Section.CANCEL, nonsense_when_idle,
        ("UploadMissionDoesNotCrashOnRandomMessages", "SendOutgoingMissionDoesNotCrashOnRandomMessages"),
    ),
    ProtocolCase("upload-lists-apart", "the lists are stored and handled separately", Section.TYPES, independent),
)  # fmt: skip
