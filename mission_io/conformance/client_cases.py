"""All cases that a ground station is judged by, each with the trick that the vehicle plays, and their judges."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from mission_io.conformance import client_case as t
from mission_io.conformance.case import (
    ITEMS,
    LIST_NAMES,
    REQUESTS,
    STATION,
    FailedError,
    LackingError,
    Section,
    check,
    difference,
)
from mission_io.conformance.client_case import ClientCase, HeardMessage, Operation, StationEvidence
from mission_io.conformance.probe import result_name
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionType
from mission_io.wire import messages as m
from mission_io.wire.messages import item_from_message

# Judges of a ground station: its messages, their order and times, and its report to the user.

Judge = Callable[[StationEvidence], str]


def judged_by(*judges: Judge) -> Judge:
    """Several judges after the ones that every case has; their observations, joined."""

    def judge(e: StationEvidence) -> str:
        _addressed(e)
        check(not e.unending, f"still sending after {e.lasted_s:.0f} s")
        return "; ".join(filter(None, (one(e) for one in judges)))

    return judge


def _addressed(e: StationEvidence) -> None:
    """Everything is for the vehicle, and about the list that it was begun with."""
    for h in e.heard:
        target = getattr(h.message, "target_system", e.vehicle.system_id)
        check(
            target in (0, e.vehicle.system_id),
            f"{type(h.message).__name__} for system {target}; the vehicle is {e.vehicle.system_id}",
        )
    for h in e.of(*ITEMS):
        check(getattr(h.message, "mission_type", 0) == e.mission_type, "items of a different list from the COUNT")


def _seq(message: m.Message) -> int:
    seq: int = getattr(message, "seq", -1)
    return seq


def _steps(e: StationEvidence) -> tuple[type[m.Message], ...]:
    """The station's progress: items of an upload, requests of a download."""
    return REQUESTS if e.operation in (Operation.DOWNLOAD, Operation.CANCEL_DOWNLOAD) else ITEMS


def _acks(e: StationEvidence, result: MissionResult) -> list[HeardMessage]:
    return [h for h in e.of(m.MissionAck) if getattr(h.message, "result", None) == result]


def _answers(e: StationEvidence, result: MissionResult) -> list[HeardMessage]:
    """The vehicle's acknowledgements with a result."""
    return [h for h in e.answered(m.MissionAck) if getattr(h.message, "result", None) == result]


def completes(e: StationEvidence) -> str:
    """It completes and reports success, although messages were lost, late, repeated or strange."""
    if e.operation in (Operation.DOWNLOAD, Operation.CANCEL_DOWNLOAD):
        return _download_completes(e)
    wrong = _unlike_what_was_sent(e)
    good = _answers(e, MissionResult.ACCEPTED)
    check(not wrong, f"the vehicle never had every item: {wrong}")
    check(e.reported_success is not False, "the vehicle accepted the list, but the ground station reported a failure")
    late = [h for h in e.of(*ITEMS) if good and h.at_s > good[-1].at_s + STATION.crossing_s]
    check(not late, f"item {_seq(late[0].message) if late else 0} came after the ACK")
    return f"{len(e.held)} items in {e.lasted_s:.1f} s"


def _unlike_what_was_sent(e: StationEvidence) -> str:
    """The difference between the station's list and the vehicle's list; empty without one."""
    sent = {_seq(h.message): h.message for h in e.of(*ITEMS)}
    return difference([item_from_message(got) for _, got in sorted(sent.items()) if isinstance(got, ITEMS)], e.held)


def _download_completes(e: StationEvidence) -> str:
    requested = {_seq(h.message) for h in e.of(*REQUESTS)}
    missing = set(range(len(e.old))) - requested
    check(not missing, f"items {sorted(missing)} were never requested")
    check(_acks(e, MissionResult.ACCEPTED), "no ACK ACCEPTED at the end")
    check(e.reported_success is not False, "every item was sent, but the ground station reported a failure")
    return f"{len(e.old)} items in {e.lasted_s:.1f} s"


def thanks(e: StationEvidence) -> str:
    """An empty list is acknowledged, too."""
    check(_acks(e, MissionResult.ACCEPTED), "no ACK ACCEPTED")
    check(not e.of(*REQUESTS), "requested an item of an empty list")
    check(e.reported_success is not False, "the ground station reported a failure")
    return "ACK ACCEPTED"


def gives_up(e: StationEvidence) -> str:
    """It comes to an end although there is no answer, and reports a failure to its user."""
    check(e.reported_success is not True, "the ground station reported success")
    return f"{len(e.heard)} messages in {e.lasted_s:.1f} s, then it stopped"


def ends(e: StationEvidence) -> str:
    """It comes to an end, and a reported success is a real one."""
    if e.reported_success and e.operation is Operation.UPLOAD:
        wrong = _unlike_what_was_sent(e)
        check(not wrong, f"the ground station reported success; the vehicle's list differs: {wrong}")
    return (
        f"ended after {e.lasted_s:.1f} s"
        + {None: "", True: ", reported success", False: ", reported failure"}[e.reported_success]
    )


def not_a_success(e: StationEvidence) -> str:
    """It ends, and does not call it a success."""
    check(e.reported_success is not True, "the ground station reported success")
    return ends(e)


def again(*kinds: type[m.Message], times: int = 2, seq: int | None = None) -> Judge:
    """It repeats a message without an answer."""

    def judge(e: StationEvidence) -> str:
        sent = [h for h in e.of(*kinds) if seq in (None, _seq(h.message))]
        what = kinds[0].__name__
        check(len(sent) >= times, f"{what} was sent {len(sent)} times")
        return f"{what} again after {sent[1].at_s - sent[0].at_s:.2f} s"

    return judge


def int_items(e: StationEvidence) -> str:
    """Items go out as MISSION_ITEM_INT, with the frames of integers."""
    floats = [_seq(h.message) for h in e.of(m.MissionItemFloat)]
    check(not floats, f"items {sorted(set(floats))} were sent as MISSION_ITEM")
    if not e.of(m.MissionItemInt):
        raise FailedError("no item was sent")
    return ""


def int_frames(e: StationEvidence) -> str:
    """The frames are those whose names end in INT, or that of no position."""
    frames = {h.message.frame for h in e.of(m.MissionItemInt) if isinstance(h.message, m.MissionItemInt)}
    check(frames <= {2, 5, 6, 11}, f"frames {sorted(frames)}: not those of integers")
    return f"frames {sorted(frames)}"


def int_requests(e: StationEvidence) -> str:
    """Items are requested with MISSION_REQUEST_INT."""
    check(not e.of(m.MissionRequest), "asked with the deprecated MISSION_REQUEST")
    return "asked with MISSION_REQUEST_INT"


def only_requested_items(e: StationEvidence) -> str:
    """Each item answers a request."""
    for h in e.of(*ITEMS):
        seq = _seq(h.message)
        requested = any(_seq(q.message) == seq and q.at_s <= h.at_s for q in e.answered(*REQUESTS))
        check(requested, f"item {seq} was sent before its request")
    return "each item after its request"


def in_order(e: StationEvidence) -> str:
    """Items are requested from 0 on."""
    order = list(dict.fromkeys(_seq(h.message) for h in e.of(*REQUESTS)))
    check(order == sorted(order), f"requested {order}")
    return ""


def stops_at(result: MissionResult) -> Judge:
    """An error ends the operation: no more items, and its user hears of it. A new operation may follow."""

    def judge(e: StationEvidence) -> str:
        check(e.reported_success is not True, "the ground station reported success")
        errors = [h.at_s for h in _answers(e, result)]
        if not errors:
            raise LackingError("it did not reach this step")
        counts = [h.at_s for h in e.of(m.MissionCount if e.operation is Operation.UPLOAD else m.MissionRequestList)]
        for h in e.of(*_steps(e)):
            error = max((at for at in errors if at + STATION.crossing_s < h.at_s), default=None)
            begun_anew = error is not None and any(error < at <= h.at_s for at in counts)
            check(
                error is None or begun_anew,
                f"{type(h.message).__name__} {_seq(h.message)} {h.at_s - (error or 0.0):.1f} s after ACK {result_name(result)}",
            )
        anew = len([at for at in counts if at > errors[0]])
        return f"stopped after {e.lasted_s:.1f} s" + (f", restarted {anew} times" if anew else "")

    return judge


def no_item_of_another_list(e: StationEvidence) -> str:
    """A request for another list got no item."""
    for h in e.heard:
        strange = isinstance(h.message, ITEMS) and h.message.mission_type != e.mission_type
        check(not strange, "a request about another list was answered with an item")
    return ""


def never_beyond(e: StationEvidence) -> str:
    """No item is sent that was not announced."""
    counts = [h.message.count for h in e.of(m.MissionCount) if isinstance(h.message, m.MissionCount)]
    beyond = [_seq(h.message) for h in e.of(*ITEMS) if counts and _seq(h.message) >= max(counts)]
    check(not beyond, f"item {beyond[0] if beyond else 0} was sent, which does not exist")
    return ""


def cancels(e: StationEvidence) -> str:
    """ACK OPERATION_CANCELLED, and then nothing."""
    said = _acks(e, MissionResult.OPERATION_CANCELLED)
    if not said:
        if _answers(e, MissionResult.ACCEPTED) or (
            e.operation is Operation.CANCEL_DOWNLOAD and _acks(e, MissionResult.ACCEPTED)
        ):
            raise LackingError("it was not cancelled")
        raise FailedError("it stopped without ACK OPERATION_CANCELLED")
    late = [h for h in e.of(*_steps(e)) if h.at_s > said[0].at_s + STATION.crossing_s]
    check(not late, "it continued after its ACK OPERATION_CANCELLED")
    check(e.reported_success is not True, "the ground station reported success")
    return "ACK OPERATION_CANCELLED, then nothing"


def cleared(e: StationEvidence) -> str:
    """CLEAR_ALL, and the vehicle's list is empty."""
    check(e.of(m.MissionClearAll), "no CLEAR_ALL")
    holds_nothing(e)
    return f"{len(e.of(m.MissionClearAll))} CLEAR_ALL"


def holds_nothing(e: StationEvidence) -> str:
    """An empty list was uploaded."""
    check(not e.held, f"the vehicle has {len(e.held)} items")
    check(e.reported_success is not False, "the list is empty, but the ground station reported a failure")
    return "COUNT 0"


_UP, _DOWN, _CLEAR, _SET = Operation.UPLOAD, Operation.DOWNLOAD, Operation.CLEAR, Operation.SET_CURRENT
_RESENT: Final = "a message without an answer is sent again"
_GIVEN_UP: Final = "after some retries the operation is cancelled"
_ERROR: Final = "an error is unrecoverable: both sides go idle"
_ITS_OWN: Final = "a message is for the station that it names"
_DROPPED: Final = "the item is dropped, the expected one requested again"


def _case(
    name: str, operation: Operation, says: str, section: Section, trick: Callable[[], t.Trick], *judge: Judge,
    like: tuple[str, ...] = (), mission_type: MissionType | None = None,
) -> ClientCase:  # fmt: skip
    return ClientCase(name, says, section, judged_by(*judge), like, operation, trick, mission_type)


def _accepted(message: Any) -> bool:
    return isinstance(message, m.MissionAck) and message.result == MissionResult.ACCEPTED


def _ack(message: Any, result: MissionResult = MissionResult.ACCEPTED) -> m.MissionAck:
    return t.refusal(message, result)


def _typed(
    name: str, operation: Operation, section: Section, says: str, like: tuple[str, ...], *judge: Judge
) -> list[ClientCase]:
    return [
        _case(f"{name}-{LIST_NAMES[it].split()[0]}", operation, says, section, t.Trick, *judge, like=like, mission_type=it)
        for it in MissionType
    ]  # fmt: skip


_NACKS: Final = [result for result in MissionResult if result is not MissionResult.ACCEPTED]

UPLOADS: Final[tuple[ClientCase, ...]] = (
    *_typed(
        "upload", _UP, Section.UPLOAD, "COUNT, then each requested item, until the ACK",
        ("UploadMissionSendsCount", "UploadMissionSendsMissionItems", "UploadMissionDoesComplainAboutWrongSequence",
         "UploadMissionDoesComplainAboutInconsistentMissionTypesInAPI",
         "UploadMissionDoesComplainAboutInconsistentMissionTypesInItems"),
        completes, int_items,
    ),
    _case("upload-int-frames", _UP, "frames whose names end in INT", Section.FRAMES, t.Trick, completes, int_frames),
    _case("upload-only-asked", _UP, "a request is answered with that item", Section.UPLOAD,
          lambda: t.late(REQUESTS, 0.05), completes, only_requested_items),
    _case("upload-empty", Operation.EMPTY, "COUNT 0 has the effect of a clear", Section.UPLOAD, t.Trick, holds_nothing,
          like=("UploadMissionDoesComplainAboutNoItems",)),
    _case("upload-count-lost", _UP, _RESENT, Section.TIMEOUTS, lambda: t.Deaf((m.MissionCount,), 1),
          again(m.MissionCount), completes, like=("UploadMissionResendsCount",)),
    _case("upload-no-answer", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionCount,)), gives_up,
          like=("UploadMissionTimeoutAfterSendCount",)),
    _case("upload-items-lost", _UP, "an item is sent again at a repeated request", Section.UPLOAD,
          lambda: t.EachOnceDeaf(ITEMS), completes, like=("UploadMissionResendsMissionItems",)),
    _case("upload-requests-lost", _UP, "the vehicle asks again", Section.TIMEOUTS,
          lambda: t.Instead(t.is_request(1), lambda _: [], 3), completes),
    _case("upload-asked-for-ever", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf(ITEMS), gives_up,
          like=("UploadMissionResendsMissionItemsButGivesUpAfterSomeRetries",)),
    _case("upload-silence", _UP, _GIVEN_UP, Section.TIMEOUTS,
          lambda: t.FallsSilent(1), gives_up,
          like=("UploadMissionTimeoutAfterSendMissionItem",)),
    _case("upload-reboot", _UP, "back to idle when the other side falls silent", Section.TIMEOUTS,
          lambda: t.FallsSilent(1, 3.0), ends),
    _case("upload-slow", _UP, "time-outs are not errors", Section.ERRORS, lambda: t.late(REQUESTS, 0.8), completes,
          like=("UploadMissionTimeoutNotTriggeredDuringTransfer",)),
    _case("upload-twice", _UP, "messages may arrive twice", Section.TIMEOUTS, lambda: t.again((*REQUESTS, m.MissionAck), 2),
          completes),
    _case("upload-lossy", _UP, "the protocol is for lossy links", Section.MESSAGES, lambda: t.Loses(0.2), completes),
    _case("upload-early-ack", _UP, "the ACK follows the last item", Section.UPLOAD,
          lambda: t.Instead(t.is_request(1), lambda it: [t.Said(_ack(it))]), not_a_success,
          like=("UploadMissionAckArrivesTooEarly",)),
    _case("upload-ack-lost", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Instead(_accepted, lambda _: []), ends),
    _case("upload-ack-late", _UP, "time-outs are not errors", Section.ERRORS,
          lambda: t.Instead(_accepted, lambda it: [t.Said(it, 2.5)]), completes),
    _case("upload-old-requests", _UP, "MISSION_REQUEST is answered with MISSION_ITEM_INT", Section.DEPRECATED,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionRequestInt),
                            lambda it: [
                                t.Said(m.MissionRequest(it.target_system, it.target_component, it.seq, it.mission_type))
                            ]),
          completes, int_items, like=("UploadMissionNacksNonIntCase",)),
    _case("upload-asked-beyond", _UP, "items are numbered from 0 to count - 1", Section.ITEMS,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=60000)), 1), never_beyond, ends),
    _case("upload-asked-out-of-order", _UP, "out-of-sequence messages are recoverable", Section.ERRORS,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=2)), 1), completes),
    _case("upload-other-list-ack", _UP, "each list has its own operations", Section.TYPES,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.of_other_list(_ack(it)))), completes),
    _case("upload-other-list-request", _UP, "each list has its own operations", Section.TYPES,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.of_other_list(it))), no_item_of_another_list, completes),
    _case("upload-other-station-ack", _UP, _ITS_OWN, Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.to_other_station(_ack(it, MissionResult.INVALID)))), completes),
    _case("upload-other-vehicle-ack", _UP, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(_ack(it, MissionResult.INVALID), sender=t.OTHER_VEHICLE)),
          completes),
    _case("upload-other-vehicle-request", _UP, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=60001), sender=t.OTHER_VEHICLE)),
          never_beyond, completes),
    _case("upload-id", _UP, "the ACK carries the id of the list", Section.CHANGES,
          lambda: t.Instead(_accepted, lambda it: [t.Said(replace(it, opaque_id=0xDEADBEEF))]), completes),
    _case("upload-no-space", _UP, _ERROR, Section.ERRORS, lambda: t.refuses(MissionResult.NO_SPACE, at=0),
          stops_at(MissionResult.NO_SPACE)),
    _case("upload-error-at-end", _UP, _ERROR, Section.ERRORS,
          lambda: t.Instead(_accepted, lambda it: [t.Said(_ack(it, MissionResult.INVALID))]), stops_at(MissionResult.INVALID)),
    *(
        _case(f"upload-nack-{result.name}", _UP, _ERROR, Section.ERRORS, lambda result=result: t.refuses(result),  # type: ignore[misc]
              stops_at(result), like=("UploadMissionNackAreHandled",))
        for result in _NACKS
    ),
    _case("upload-cancel", Operation.CANCEL_UPLOAD, "a request is answered OPERATION_CANCELLED", Section.CANCEL,
          lambda: t.late(REQUESTS, 0.5), cancels, like=("UploadMissionCanBeCancelled",)),
)  # fmt: skip

DOWNLOADS: Final[tuple[ClientCase, ...]] = (
    *_typed(
        "download", _DOWN, Section.DOWNLOAD, "the list, each item in order, then ACK ACCEPTED",
        ("DownloadMissionSendsRequestList", "DownloadMissionSendsMissionRequests",
         "DownloadMissionSendsAllMissionRequestsAndAck"),
        completes, in_order,
    ),
    _case("download-int-requests", _DOWN, "MISSION_REQUEST is deprecated and must not be sent", Section.DEPRECATED, t.Trick,
          completes, int_requests),
    _case("download-list-lost", _DOWN, _RESENT, Section.TIMEOUTS, lambda: t.Deaf((m.MissionRequestList,), 1),
          again(m.MissionRequestList), completes, like=("DownloadMissionResendsRequestList",)),
    _case("download-no-answer", _DOWN, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionRequestList,)), gives_up,
          like=("DownloadMissionResendsRequestListButGivesUpAfterSomeRetries",)),
    _case("download-items-lost", _DOWN, _RESENT, Section.TIMEOUTS, lambda: t.EachOnceDeaf(REQUESTS),
          again(*reversed(REQUESTS), seq=0), completes),
    _case("download-silence", _DOWN, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf(REQUESTS), gives_up,
          like=("DownloadMissionResendsMissionRequestsAndTimesOutEventually",)),
    _case("download-second-item-lost", _DOWN, "each request has its own retries", Section.TIMEOUTS,
          lambda: t.Deaf(REQUESTS, 3, 1), again(*reversed(REQUESTS), times=4, seq=1), completes,
          like=("DownloadMissionResendsRequestItemAgainForSecondItem",)),
    _case("download-twice", _DOWN, "items may arrive twice", Section.TIMEOUTS, lambda: t.again(ITEMS, 3), completes,
          like=("DownloadMissionDoesntHaveDuplicates",)),
    _case("download-empty", _DOWN, "all operations end with an ACK", Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(replace(it, count=0))]), thanks,
          like=("DownloadMissionEmptyList",)),
    _case("download-slow", _DOWN, "time-outs are not errors", Section.ERRORS, lambda: t.late(ITEMS, 0.8), completes,
          like=("DownloadMissionTimeoutNotTriggeredDuringTransfer",)),
    _case("download-lossy", _DOWN, "the protocol is for lossy links", Section.MESSAGES, lambda: t.Loses(0.2), completes),
    _case("download-out-of-order", _DOWN, _DROPPED, Section.DOWNLOAD,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(replace(it, seq=2))], 1),
          again(*reversed(REQUESTS), seq=0), completes),
    _case("download-other-list", _DOWN, _DROPPED, Section.TYPES,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(t.of_other_list(it))], 1),
          again(*reversed(REQUESTS), seq=0), completes),
    _case("download-other-station", _DOWN, _ITS_OWN, Section.ROUTING,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(t.to_other_station(it))], 1),
          again(*reversed(REQUESTS), seq=0), completes),
    _case("download-other-vehicle", _DOWN, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(it, sender=t.OTHER_VEHICLE)], 1),
          again(*reversed(REQUESTS), seq=0), completes),
    _case("download-error-at-list", _DOWN, _ERROR, Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(_ack(it, MissionResult.DENIED))]),
          stops_at(MissionResult.DENIED)),
    _case("download-error-at-item", _DOWN, _ERROR, Section.ERRORS,
          lambda: t.Instead(t.is_item(1), lambda it: [t.Said(_ack(it, MissionResult.INVALID))]),
          stops_at(MissionResult.INVALID)),
    _case("download-float-items", _DOWN, "MISSION_ITEM must be accepted, too", Section.DOWNLOAD,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionItemInt), lambda it: [t.Said(t.as_float(it))]), completes),
    _case("download-count-beyond", _DOWN, "an item that does not exist is answered with an error", Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), t.with_count(2)), not_a_success),
    _case("download-count-changes", _DOWN, "a late COUNT is recoverable", Section.ERRORS,
          lambda: t.before(
              t.is_item(1), lambda it: t.Said(m.MissionCount(it.target_system, it.target_component, 2, it.mission_type)), 1),
          ends),
    _case("download-id", _DOWN, "the COUNT carries the id of the list", Section.CHANGES,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(replace(it, opaque_id=0xDEADBEEF))]),
          completes),
    _case("download-cancel", Operation.CANCEL_DOWNLOAD, "ACK OPERATION_CANCELLED", Section.CANCEL,
          lambda: t.late(ITEMS, 0.5), cancels, like=("DownloadMissionCanBeCancelled",)),
)  # fmt: skip

OTHERS: Final[tuple[ClientCase, ...]] = (
    *_typed("clear", _CLEAR, Section.CLEAR, "CLEAR_ALL, then the vehicle's ACK", ("ClearMissionSendsClear",), cleared),
    _case("clear-lost", _CLEAR, _RESENT, Section.CLEAR, lambda: t.Deaf((m.MissionClearAll,), 1), again(m.MissionClearAll),
          cleared),
    _case("clear-no-answer", _CLEAR, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionClearAll,)), gives_up),
    _case("clear-refused", _CLEAR, "an error cancels the operation", Section.CLEAR,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionAck), lambda it: [t.Said(_ack(it, MissionResult.UNSUPPORTED))]),
          not_a_success),
    _case("clear-other-list-ack", _CLEAR, "each list has its own operations", Section.TYPES,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionAck), lambda it: [t.Said(t.of_other_list(it))], 1),
          again(m.MissionClearAll), cleared),
    _case("current", _SET, "the item is set", Section.CURRENT, t.Trick, ends, like=("SetCurrentSendsSetCurrent",)),
    _case("current-lost", _SET, _RESENT, Section.CURRENT, lambda: t.Deaf((m.MissionSetCurrent,), 1),
          again(m.MissionSetCurrent), like=("SetCurrentWithRetransmissionAndSuccess",)),
    _case("current-no-answer", _SET, _GIVEN_UP, Section.CURRENT, lambda: t.Deaf((m.MissionSetCurrent,)), gives_up,
          like=("SetCurrentWithRetransmissionAndTimeout",)),
    _case("current-wrong", _SET, "MISSION_CURRENT names another item: sent again", Section.CURRENT,
          lambda: t.Deaf((m.MissionSetCurrent,), 2),
          again(m.MissionSetCurrent, times=3), like=("SetCurrentWithRetransmissionWhenWrong",)),
)  # fmt: skip

CLIENT_CASES: Final[tuple[ClientCase, ...]] = (*UPLOADS, *DOWNLOADS, *OTHERS)
