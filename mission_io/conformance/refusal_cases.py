"""Cases for a vehicle whose upload is stopped, disturbed, or cannot be: cancel, errors, second stations, wrong addresses."""

from dataclasses import replace
from functools import partial
from typing import Final

from mission_io.conformance.case import (
    LIST_NAMES,
    PROBE,
    REQUESTS,
    FailedError,
    LackingError,
    ProtocolCase,
    RefusedError,
    Section,
    check,
    for_each_list,
    sample,
)
from mission_io.conformance.probe import Probe, described, seq_of
from mission_io.conformance.upload_cases import accepted, begin_three, finished
from mission_io.model.enums import MissionResult
from mission_io.model.items import ALL_MISSION_TYPES, Command, MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from mission_io.wire.messages import Heartbeat, MissionAck, MissionRequestInt

# Cases for clearing, the current item, a vehicle's stated capabilities, and the ids of its lists.

_CAN_INT: Final = 1 << 2
_CAN: Final = {MissionType.FENCE: 1 << 14, MissionType.RALLY: 1 << 15}


def cleared(t: MissionType, p: Probe) -> str:
    """CLEAR_ALL empties a list."""
    p.hold_sample(t, 4)
    answer = p.ask(m.MissionClearAll(*p.to, t), t, (m.MissionAck,))
    accepted(p, answer, "CLEAR_ALL was not answered")
    p.check_held(t, (), "after CLEAR_ALL")
    return "accepted, list empty"


def cleared_twice(p: Probe) -> str:
    """A list that is empty already."""
    p.hold(_MISSION, ())
    for _ in range(2):
        answer = p.ask(m.MissionClearAll(*p.to, _MISSION), _MISSION, (m.MissionAck,))
        accepted(p, answer, "CLEAR_ALL of an empty list was not answered")
    return "accepted each time"


def cleared_alone(p: Probe) -> str:
    """Clearing one list leaves the others."""
    kept = [t for t in (MissionType.FENCE, MissionType.RALLY) if p.reads_list(t)]
    if not kept:
        raise LackingError("it has only a mission")
    for t in kept:
        p.hold_sample(t, 4)
    p.ask(m.MissionClearAll(*p.to, _MISSION), _MISSION, (m.MissionAck,))
    p.rest()
    for t in kept:
        p.check_held(t, sample(t, 4), f"the {LIST_NAMES[t]} after the mission was cleared")
    return f"{', '.join(LIST_NAMES[t] for t in kept)} unchanged"


def cleared_all(p: Probe) -> str:
    """mission_type 255 empties all three."""
    kept = [t for t in MissionType if t is _MISSION or p.reads_list(t)]
    for t in kept:
        p.hold_sample(t, 4)
    p.forget()
    p.send(m.MissionClearAll(*p.to, ALL_MISSION_TYPES))
    answer = p.hear(lambda got: isinstance(got, m.MissionAck), 2.0 * PROBE.answer_s)
    if not isinstance(answer, m.MissionAck):
        raise FailedError("CLEAR_ALL of all lists was not answered")
    if answer.result != MissionResult.ACCEPTED:
        raise RefusedError(described(answer))
    p.rest()
    for t in kept:
        p.check_held(t, (), f"the {LIST_NAMES[t]} after all lists were cleared")
    return f"{', '.join(LIST_NAMES[t] for t in kept)} empty"


def _current(p: Probe, seq: int | None = None) -> m.MissionCurrent | None:
    found = p.hear(lambda got: isinstance(got, m.MissionCurrent) and seq in (None, got.seq), PROBE.current_s)
    return found if isinstance(found, m.MissionCurrent) else None


def _requested_current(p: Probe) -> None:
    """Some vehicles send MISSION_CURRENT only to those who want it."""
    interval = (float(message_id(m.MissionCurrent)), 500_000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    p.send(m.CommandLong(*p.to, Command.SET_MESSAGE_INTERVAL, interval))


def current_set(p: Probe) -> str:
    """MISSION_SET_CURRENT is followed by MISSION_CURRENT with that number."""
    p.hold_sample(_MISSION, 5)
    _requested_current(p)
    for seq in (2, 3):
        p.forget()
        p.send(m.MissionSetCurrent(*p.to, seq))
        if _current(p, seq=seq) is None:
            last = _current(p)
            if last is None:
                raise LackingError("it sends no MISSION_CURRENT")
            raise FailedError(f"after MISSION_SET_CURRENT {seq}, MISSION_CURRENT says {last.seq}")
    return "MISSION_CURRENT followed"


def current_beyond(p: Probe) -> str:
    """An item that does not exist does not become the current one, and STATUSTEXT reports it."""
    p.hold_sample(_MISSION, 3)
    _requested_current(p)
    p.forget()
    p.send(m.MissionSetCurrent(*p.to, 900))
    texts: list[str] = []
    until = p.now() + PROBE.current_s
    while p.now() < until:
        message = p.hear(lambda got: isinstance(got, m.StatusText | m.MissionCurrent), max(0.0, until - p.now()))
        if isinstance(message, m.StatusText):
            texts.append(message.text)
        elif isinstance(message, m.MissionCurrent):
            check(message.seq != 900, "MISSION_CURRENT says 900 of 3")
    check(texts, "no STATUSTEXT")
    return f"STATUSTEXT {texts[0]!r}"


def streamed(p: Probe) -> str:
    """MISSION_CURRENT is sent without a request."""
    p.hold_sample(_MISSION, 3)
    _requested_current(p)
    current = _current(p)
    if current is None:
        raise FailedError("it sends no MISSION_CURRENT, even on request")
    return f"MISSION_CURRENT {current.seq}, total {current.total}"


def _uploaded_id(p: Probe, first: int) -> int:
    new = sample(_MISSION, 4, first=first)
    p.begin_upload(4, _MISSION)
    ack = p.finish_upload(new, _MISSION)
    accepted(p, ack)
    return ack.opaque_id


def ids_agree(p: Probe) -> str:
    """ACK, COUNT and MISSION_CURRENT carry the same id."""
    in_ack = _uploaded_id(p, 50)
    p.forget()
    answer = p.ask(m.MissionRequestList(*p.to, _MISSION), _MISSION, (m.MissionCount,))
    p.send(p.ack(MissionResult.ACCEPTED))
    in_count = answer.opaque_id if isinstance(answer, m.MissionCount) else 0
    _requested_current(p)
    p.forget()
    current = _current(p)
    in_current = 0 if current is None else current.mission_id
    seen = f"ACK {in_ack}, COUNT {in_count}, MISSION_CURRENT {in_current}"
    if not (in_ack or in_count or in_current):
        raise LackingError("no ids")
    check(in_ack == in_count == in_current, seen)
    return seen


def ids_differ(p: Probe) -> str:
    """Another mission has another id."""
    ids = [_uploaded_id(p, first) for first in (50, 80)]
    if not any(ids):
        raise LackingError("no ids")
    check(ids[0] != ids[1], f"two missions, one id: {ids[0]}")
    return f"{ids[0]}, then {ids[1]}"


def capabilities(p: Probe) -> str:
    """AUTOPILOT_VERSION names its lists, and that it takes integers."""
    requested = (float(message_id(m.AutopilotVersion)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    version = None
    for _ in range(3):
        p.forget()
        p.send(m.CommandLong(*p.to, Command.REQUEST_MESSAGE, requested))
        version = p.hear(lambda got: isinstance(got, m.AutopilotVersion), PROBE.answer_s)
        if version is not None:
            break
    if not isinstance(version, m.AutopilotVersion):
        raise LackingError("no AUTOPILOT_VERSION")
    check(version.capabilities & _CAN_INT, "it does not say that it accepts MISSION_ITEM_INT")
    for t, bit in _CAN.items():
        says, has = bool(version.capabilities & bit), p.reads_list(t)
        said = "it has" if says else "nothing of"
        check(says == has, f"it says {said} a list of {LIST_NAMES[t]}, and answers {'' if has else 'nothing '}about it")
    return "as it does"


LIST_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (
    *for_each_list("clear", "the list is emptied, then ACK ACCEPTED", Section.CLEAR, cleared, ("ClearMissionSendsClear",)),
    ProtocolCase("clear-twice", "a request without an answer is sent again", Section.CLEAR, cleared_twice),
    ProtocolCase("clear-alone", "the lists are handled separately", Section.TYPES, cleared_alone),
    ProtocolCase("clear-all", "mission_type 255 is all of them", Section.CLEAR, cleared_all),
    ProtocolCase(
        "current-set", "MISSION_CURRENT with the new number is broadcast", Section.CURRENT, current_set,
        ("SetCurrentSendsSetCurrent", "SetCurrentWithRetransmissionAndSuccess"),
    ),
    ProtocolCase(
        "current-beyond", "STATUSTEXT says that it failed", Section.CURRENT, current_beyond,
        ("SetCurrentWithInvalidInput",),
    ),
    ProtocolCase("current-streamed", "MISSION_CURRENT is streamed", Section.PROGRESS, streamed),
    ProtocolCase("ids-agree", "the id of a list is in ACK, COUNT and MISSION_CURRENT", Section.CHANGES, ids_agree),
    ProtocolCase("ids-differ", "another list has another id", Section.CHANGES, ids_differ),
    ProtocolCase(
        "capabilities", "AUTOPILOT_VERSION says what there is", Section.MESSAGES, capabilities, ("IntMessagesNotSupported",)
    ),
)  # fmt: skip


_MISSION: Final = MissionType.MISSION


def stopped_by(result: MissionResult, t: MissionType, p: Probe) -> str:
    """The station answers a request with an error: the vehicle stops, and the old list stays."""
    old = p.hold_sample(t, 7)
    begin_three(p, t)
    p.send(p.ack(result, t))
    p.quiet(0.5)
    late = [got for got in p.quiet(PROBE.stops_s) if isinstance(got, REQUESTS)]
    check(not late, f"{len(late)} more requests after ACK {result.name}")
    p.check_held(t, old, f"the old list after ACK {result.name}")
    return "stopped, old list unchanged"


def bad_item(p: Probe) -> str:
    """An item that cannot be: an error, and the old list stays."""
    old = p.hold_sample(_MISSION, 7)
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
    old = p.hold_sample(_MISSION, 4)
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
    p.hold_sample(t, 4)
    p.forget()
    answer = p.ask(p.count(0, t), t)
    accepted(p, answer, f"COUNT 0 was answered with {described(answer)}")
    p.check_held(t, (), "after COUNT 0")
    return "accepted, list empty"


def _beat_as_other(p: Probe) -> None:
    p.send(Heartbeat(autopilot=8, vehicle_type=6, system_status=4), as_other=True)


def second_upload(p: Probe) -> str:
    """Another station announces an upload in the middle of one."""
    _beat_as_other(p)
    new = p.begin_new(4)
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
    finished(p, new, "after a second station announced an upload", first=1, wait_s=2.0 * PROBE.answer_s)
    return f"the second station got {described(to_other)}; the first one's list is there"


def foreign_items(p: Probe) -> str:
    """Another station's items do not get into the list."""
    foreign = sample(_MISSION, 4, first=90)
    _beat_as_other(p)
    new = p.begin_new(4)
    for seq in range(4):
        p.send(p.item(foreign, seq), as_other=True)
        p.send(p.item(new, seq))
    accepted(p, p.answer(_MISSION, 2.0 * PROBE.answer_s, (MissionAck,)))
    p.quiet(1.0)
    p.check_held(_MISSION, new, "after another station sent items")
    return "they were ignored"


def other_list(p: Probe) -> str:
    """An item for another list does not get into this one."""
    stray = sample(MissionType.RALLY, 1)
    new = p.begin_new(3)
    p.send(p.item(stray, 0, MissionType.RALLY))
    p.quiet(0.3)
    finished(p, new, "after an item for the rally points")
    return "it was ignored"


def other_target(p: Probe) -> str:
    """Messages to another system get no answer, and change nothing."""
    old = p.hold_sample(_MISSION, 4)
    p.forget()
    p.send(replace(p.count(2), target_system=PROBE.absent_system))
    p.send(replace(p.count(2), target_system=PROBE.absent_system, target_component=0))
    said = p.quiet(2.0)
    check(not said, f"COUNT for system {PROBE.absent_system} was answered with {described(said[0]) if said else ''}")
    p.check_held(_MISSION, old, f"the list after COUNT for system {PROBE.absent_system}")
    return "no answer"


def strange_type(p: Probe) -> str:
    """A list that does not exist: an error, and nothing is changed."""
    old = p.hold_sample(_MISSION, 4)
    p.forget()
    p.send(p.count(2, PROBE.strange_type))
    said = p.quiet(2.0)
    requested = [m for m in said if isinstance(m, REQUESTS)]
    check(
        not requested,
        f"COUNT of mission_type {PROBE.strange_type}: requested items of type "
        f"{getattr(requested[0], 'mission_type', 0) if requested else 0}",
    )
    p.check_held(_MISSION, old, f"the mission after COUNT of mission_type {PROBE.strange_type}")
    return f"answered with {described(said[0] if said else None)}"


def nonsense_when_idle(p: Probe) -> str:
    """Requests, acknowledgements and items out of nowhere."""
    old = p.hold_sample(_MISSION, 4)
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


_STOPPING = (MissionResult.ERROR, MissionResult.UNSUPPORTED, MissionResult.INVALID, MissionResult.DENIED)

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
