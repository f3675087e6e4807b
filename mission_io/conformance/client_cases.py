"""All cases that a ground station is judged by, each with the trick that the fake vehicle plays."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from mission_io.conformance import judges as j
from mission_io.conformance import tricks as t
from mission_io.conformance.case import ITEMS, LIST_NAMES, REQUESTS, Section
from mission_io.conformance.evidence import ClientCase, Operation
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionType
from mission_io.wire import messages as m

_UP, _DOWN, _CLEAR, _SET = Operation.UPLOAD, Operation.DOWNLOAD, Operation.CLEAR, Operation.SET_CURRENT
_RESENT: Final = "a message without an answer is sent again"
_GIVEN_UP: Final = "after some retries the operation is cancelled"
_ERROR: Final = "an error is unrecoverable: both sides go idle"
_ITS_OWN: Final = "a message is for the station that it names"
_DROPPED: Final = "the item is dropped, the expected one requested again"


def _case(
    name: str, operation: Operation, says: str, section: Section, trick: Callable[[], t.Trick], *judge: j.Judge,
    like: tuple[str, ...] = (), mission_type: MissionType | None = None,
) -> ClientCase:  # fmt: skip
    return ClientCase(name, says, section, j.judged_by(*judge), like, operation, trick, mission_type)


def _accepted(message: Any) -> bool:
    return isinstance(message, m.MissionAck) and message.result == MissionResult.ACCEPTED


def _ack(message: Any, result: MissionResult = MissionResult.ACCEPTED) -> m.MissionAck:
    return t.refusal(message, result)


def _typed(
    name: str, operation: Operation, section: Section, says: str, like: tuple[str, ...], *judge: j.Judge
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
        j.completes, j.int_items,
    ),
    _case("upload-int-frames", _UP, "frames whose names end in INT", Section.FRAMES, t.Trick, j.completes, j.int_frames),
    _case("upload-only-asked", _UP, "a request is answered with that item", Section.UPLOAD,
          lambda: t.late(REQUESTS, 0.05), j.completes, j.only_what_is_asked),
    _case("upload-empty", Operation.EMPTY, "COUNT 0 has the effect of a clear", Section.UPLOAD, t.Trick, j.holds_nothing,
          like=("UploadMissionDoesComplainAboutNoItems",)),
    _case("upload-count-lost", _UP, _RESENT, Section.TIMEOUTS, lambda: t.Deaf((m.MissionCount,), 1),
          j.again(m.MissionCount), j.completes, like=("UploadMissionResendsCount",)),
    _case("upload-no-answer", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionCount,)), j.gives_up,
          like=("UploadMissionTimeoutAfterSendCount",)),
    _case("upload-items-lost", _UP, "an item is sent again at a repeated request", Section.UPLOAD,
          lambda: t.EachOnceDeaf(ITEMS), j.completes, like=("UploadMissionResendsMissionItems",)),
    _case("upload-requests-lost", _UP, "the vehicle asks again", Section.TIMEOUTS,
          lambda: t.Instead(t.is_request(1), lambda _: [], 3), j.completes),
    _case("upload-asked-for-ever", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf(ITEMS), j.gives_up,
          like=("UploadMissionResendsMissionItemsButGivesUpAfterSomeRetries",)),
    _case("upload-silence", _UP, _GIVEN_UP, Section.TIMEOUTS,
          lambda: t.FallsSilent(1), j.gives_up,
          like=("UploadMissionTimeoutAfterSendMissionItem",)),
    _case("upload-reboot", _UP, "back to idle when the other side falls silent", Section.TIMEOUTS,
          lambda: t.FallsSilent(1, 3.0), j.ends),
    _case("upload-slow", _UP, "time-outs are not errors", Section.ERRORS, lambda: t.late(REQUESTS, 0.8), j.completes,
          like=("UploadMissionTimeoutNotTriggeredDuringTransfer",)),
    _case("upload-twice", _UP, "messages may arrive twice", Section.TIMEOUTS, lambda: t.again((*REQUESTS, m.MissionAck), 2),
          j.completes),
    _case("upload-lossy", _UP, "the protocol is for lossy links", Section.MESSAGES, lambda: t.Loses(0.2), j.completes),
    _case("upload-early-ack", _UP, "the ACK follows the last item", Section.UPLOAD,
          lambda: t.Instead(t.is_request(1), lambda it: [t.Said(_ack(it))]), j.not_a_success,
          like=("UploadMissionAckArrivesTooEarly",)),
    _case("upload-ack-lost", _UP, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Instead(_accepted, lambda _: []), j.ends),
    _case("upload-ack-late", _UP, "time-outs are not errors", Section.ERRORS,
          lambda: t.Instead(_accepted, lambda it: [t.Said(it, 2.5)]), j.completes),
    _case("upload-old-requests", _UP, "MISSION_REQUEST is answered with MISSION_ITEM_INT", Section.DEPRECATED,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionRequestInt),
                            lambda it: [
                                t.Said(m.MissionRequest(it.target_system, it.target_component, it.seq, it.mission_type))
                            ]),
          j.completes, j.int_items, like=("UploadMissionNacksNonIntCase",)),
    _case("upload-asked-beyond", _UP, "items are numbered from 0 to count - 1", Section.ITEMS,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=60000)), 1), j.never_beyond, j.ends),
    _case("upload-asked-out-of-order", _UP, "out-of-sequence messages are recoverable", Section.ERRORS,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=2)), 1), j.completes),
    _case("upload-other-list-ack", _UP, "each list has its own operations", Section.TYPES,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.of_other_list(_ack(it)))), j.completes),
    _case("upload-other-list-request", _UP, "each list has its own operations", Section.TYPES,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.of_other_list(it))), j.no_item_of_another_list, j.completes),
    _case("upload-other-station-ack", _UP, _ITS_OWN, Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(t.to_other_station(_ack(it, MissionResult.INVALID)))), j.completes),
    _case("upload-other-vehicle-ack", _UP, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(_ack(it, MissionResult.INVALID), sender=t.OTHER_VEHICLE)),
          j.completes),
    _case("upload-other-vehicle-request", _UP, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.before(t.is_request(1), lambda it: t.Said(replace(it, seq=60001), sender=t.OTHER_VEHICLE)),
          j.never_beyond, j.completes),
    _case("upload-id", _UP, "the ACK carries the id of the list", Section.CHANGES,
          lambda: t.Instead(_accepted, lambda it: [t.Said(replace(it, opaque_id=0xDEADBEEF))]), j.completes),
    _case("upload-no-space", _UP, _ERROR, Section.ERRORS, lambda: t.refuses(MissionResult.NO_SPACE, at=0),
          j.stops_at(MissionResult.NO_SPACE)),
    _case("upload-error-at-end", _UP, _ERROR, Section.ERRORS,
          lambda: t.Instead(_accepted, lambda it: [t.Said(_ack(it, MissionResult.INVALID))]), j.stops_at(MissionResult.INVALID)),
    *(
        _case(f"upload-nack-{result.name}", _UP, _ERROR, Section.ERRORS, lambda result=result: t.refuses(result),  # type: ignore[misc]
              j.stops_at(result), like=("UploadMissionNackAreHandled",))
        for result in _NACKS
    ),
    _case("upload-cancel", Operation.CANCEL_UPLOAD, "a request is answered OPERATION_CANCELLED", Section.CANCEL,
          lambda: t.late(REQUESTS, 0.5), j.cancels, like=("UploadMissionCanBeCancelled",)),
)  # fmt: skip

DOWNLOADS: Final[tuple[ClientCase, ...]] = (
    *_typed(
        "download", _DOWN, Section.DOWNLOAD, "the list, each item in order, then ACK ACCEPTED",
        ("DownloadMissionSendsRequestList", "DownloadMissionSendsMissionRequests",
         "DownloadMissionSendsAllMissionRequestsAndAck"),
        j.completes, j.in_order,
    ),
    _case("download-int-requests", _DOWN, "MISSION_REQUEST is deprecated and must not be sent", Section.DEPRECATED, t.Trick,
          j.completes, j.int_requests),
    _case("download-list-lost", _DOWN, _RESENT, Section.TIMEOUTS, lambda: t.Deaf((m.MissionRequestList,), 1),
          j.again(m.MissionRequestList), j.completes, like=("DownloadMissionResendsRequestList",)),
    _case("download-no-answer", _DOWN, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionRequestList,)), j.gives_up,
          like=("DownloadMissionResendsRequestListButGivesUpAfterSomeRetries",)),
    _case("download-items-lost", _DOWN, _RESENT, Section.TIMEOUTS, lambda: t.EachOnceDeaf(REQUESTS),
          j.again(*reversed(REQUESTS), seq=0), j.completes),
    _case("download-silence", _DOWN, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf(REQUESTS), j.gives_up,
          like=("DownloadMissionResendsMissionRequestsAndTimesOutEventually",)),
    _case("download-second-item-lost", _DOWN, "each request has its own retries", Section.TIMEOUTS,
          lambda: t.Deaf(REQUESTS, 3, 1), j.again(*reversed(REQUESTS), times=4, seq=1), j.completes,
          like=("DownloadMissionResendsRequestItemAgainForSecondItem",)),
    _case("download-twice", _DOWN, "items may arrive twice", Section.TIMEOUTS, lambda: t.again(ITEMS, 3), j.completes,
          like=("DownloadMissionDoesntHaveDuplicates",)),
    _case("download-empty", _DOWN, "all operations end with an ACK", Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(replace(it, count=0))]), j.thanks,
          like=("DownloadMissionEmptyList",)),
    _case("download-slow", _DOWN, "time-outs are not errors", Section.ERRORS, lambda: t.late(ITEMS, 0.8), j.completes,
          like=("DownloadMissionTimeoutNotTriggeredDuringTransfer",)),
    _case("download-lossy", _DOWN, "the protocol is for lossy links", Section.MESSAGES, lambda: t.Loses(0.2), j.completes),
    _case("download-out-of-order", _DOWN, _DROPPED, Section.DOWNLOAD,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(replace(it, seq=2))], 1),
          j.again(*reversed(REQUESTS), seq=0), j.completes),
    _case("download-other-list", _DOWN, _DROPPED, Section.TYPES,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(t.of_other_list(it))], 1),
          j.again(*reversed(REQUESTS), seq=0), j.completes),
    _case("download-other-station", _DOWN, _ITS_OWN, Section.ROUTING,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(t.to_other_station(it))], 1),
          j.again(*reversed(REQUESTS), seq=0), j.completes),
    _case("download-other-vehicle", _DOWN, "a vehicle answers only for itself", Section.ROUTING,
          lambda: t.Instead(t.is_item(0), lambda it: [t.Said(it, sender=t.OTHER_VEHICLE)], 1),
          j.again(*reversed(REQUESTS), seq=0), j.completes),
    _case("download-error-at-list", _DOWN, _ERROR, Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(_ack(it, MissionResult.DENIED))]),
          j.stops_at(MissionResult.DENIED)),
    _case("download-error-at-item", _DOWN, _ERROR, Section.ERRORS,
          lambda: t.Instead(t.is_item(1), lambda it: [t.Said(_ack(it, MissionResult.INVALID))]),
          j.stops_at(MissionResult.INVALID)),
    _case("download-float-items", _DOWN, "MISSION_ITEM must be accepted, too", Section.DOWNLOAD,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionItemInt), lambda it: [t.Said(t.as_float(it))]), j.completes),
    _case("download-count-beyond", _DOWN, "an item that does not exist is answered with an error", Section.ERRORS,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), t.with_count(2)), j.not_a_success),
    _case("download-count-changes", _DOWN, "a late COUNT is recoverable", Section.ERRORS,
          lambda: t.before(
              t.is_item(1), lambda it: t.Said(m.MissionCount(it.target_system, it.target_component, 2, it.mission_type)), 1),
          j.ends),
    _case("download-id", _DOWN, "the COUNT carries the id of the list", Section.CHANGES,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionCount), lambda it: [t.Said(replace(it, opaque_id=0xDEADBEEF))]),
          j.completes),
    _case("download-cancel", Operation.CANCEL_DOWNLOAD, "ACK OPERATION_CANCELLED", Section.CANCEL,
          lambda: t.late(ITEMS, 0.5), j.cancels, like=("DownloadMissionCanBeCancelled",)),
)  # fmt: skip

OTHERS: Final[tuple[ClientCase, ...]] = (
    *_typed("clear", _CLEAR, Section.CLEAR, "CLEAR_ALL, then the vehicle's ACK", ("ClearMissionSendsClear",), j.cleared),
    _case("clear-lost", _CLEAR, _RESENT, Section.CLEAR, lambda: t.Deaf((m.MissionClearAll,), 1), j.again(m.MissionClearAll),
          j.cleared),
    _case("clear-no-answer", _CLEAR, _GIVEN_UP, Section.TIMEOUTS, lambda: t.Deaf((m.MissionClearAll,)), j.gives_up),
    _case("clear-refused", _CLEAR, "an error cancels the operation", Section.CLEAR,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionAck), lambda it: [t.Said(_ack(it, MissionResult.UNSUPPORTED))]),
          j.not_a_success),
    _case("clear-other-list-ack", _CLEAR, "each list has its own operations", Section.TYPES,
          lambda: t.Instead(lambda it: isinstance(it, m.MissionAck), lambda it: [t.Said(t.of_other_list(it))], 1),
          j.again(m.MissionClearAll), j.cleared),
    _case("current", _SET, "the item is set", Section.CURRENT, t.Trick, j.ends, like=("SetCurrentSendsSetCurrent",)),
    _case("current-lost", _SET, _RESENT, Section.CURRENT, lambda: t.Deaf((m.MissionSetCurrent,), 1),
          j.again(m.MissionSetCurrent), like=("SetCurrentWithRetransmissionAndSuccess",)),
    _case("current-no-answer", _SET, _GIVEN_UP, Section.CURRENT, lambda: t.Deaf((m.MissionSetCurrent,)), j.gives_up,
          like=("SetCurrentWithRetransmissionAndTimeout",)),
    _case("current-wrong", _SET, "MISSION_CURRENT names another item: sent again", Section.CURRENT,
          lambda: t.Deaf((m.MissionSetCurrent,), 2),
          j.again(m.MissionSetCurrent, times=3), like=("SetCurrentWithRetransmissionWhenWrong",)),
)  # fmt: skip

CLIENT_CASES: Final[tuple[ClientCase, ...]] = (*UPLOADS, *DOWNLOADS, *OTHERS)
