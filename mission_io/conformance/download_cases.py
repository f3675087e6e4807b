"""Cases for a vehicle that serves a download."""

from dataclasses import replace
from typing import Final

from mission_io.conformance.case import (
    ITEMS,
    PROBE,
    REQUESTS,
    FailedError,
    ProtocolCase,
    RefusedError,
    Section,
    check,
    difference,
    for_each_list,
    sample,
)
from mission_io.conformance.probe import Probe, described, seq_of
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire import messages as m
from mission_io.wire.messages import item_from_message

_MISSION: Final = MissionType.MISSION
_INT_FRAMES: Final = (5, 6, 11, 2)


def _listed(p: Probe, t: MissionType) -> int:
    """Begin a download; the number of items."""
    p.forget()
    answer = p.ask(m.MissionRequestList(*p.to, t), t, (m.MissionCount, m.MissionAck))
    if isinstance(answer, m.MissionAck):
        raise RefusedError(f"the list was refused: {described(answer)}")
    if not isinstance(answer, m.MissionCount):
        raise FailedError("the request of the list was not answered")
    return answer.count


def _begun(p: Probe) -> tuple[tuple[MissionItem, ...], int]:
    """Have the vehicle hold a mission, and begin to download it: its items, and the number that it announces."""
    held = p.hold_sample(_MISSION, PROBE.listed_items)
    return held, _listed(p, _MISSION)


def _item(p: Probe, t: MissionType, seq: int) -> m.MissionItemInt | m.MissionItemFloat:
    """Request an item and return it."""
    answer = p.ask(m.MissionRequestInt(*p.to, seq, t), t, (*ITEMS, m.MissionAck))
    if not isinstance(answer, ITEMS):
        raise FailedError(f"requested item {seq}: {described(answer)}")
    check(answer.seq == seq, f"requested item {seq}, received item {answer.seq}")
    return answer


def _rest_of(p: Probe, t: MissionType, count: int, first: int = 0) -> list[m.MissionItemInt | m.MissionItemFloat]:
    items = [_item(p, t, seq) for seq in range(first, count)]
    p.send(p.ack(MissionResult.ACCEPTED, t))
    return items


def _check_items(
    p: Probe, t: MissionType, sent: tuple[MissionItem, ...], got: list[m.MissionItemInt | m.MissionItemFloat]
) -> None:
    wrong = difference(sent, [item_from_message(got) for got in got], home_first=p.home_first and t is _MISSION)
    check(not wrong, wrong)


def in_order(t: MissionType, p: Probe) -> str:
    """Count, items, each with its number and list, and for this station."""
    held = p.hold_sample(t, PROBE.listed_items)
    count = _listed(p, t)
    check(count == PROBE.listed_items, f"COUNT {count} for {PROBE.listed_items} items")
    got = _rest_of(p, t, count)
    local = p.client.local
    for message in got:
        check(message.target_system == local.system_id, f"item {message.seq} is for system {message.target_system}")
    _check_items(p, t, held, got)
    return f"COUNT {count}, items 0 to {count - 1}"


def no_items(t: MissionType, p: Probe) -> str:
    """An empty list has count 0."""
    p.hold(t, ())
    count = _listed(p, t)
    home = int(p.home_first and t is _MISSION)
    check(count <= home, f"COUNT {count} for an empty list")
    p.send(p.ack(MissionResult.ACCEPTED, t))
    return f"COUNT {count}"


def _served_once_more(p: Probe, held: tuple[MissionItem, ...], answer: m.Message | None) -> str:
    """After an odd request with any answer, a new download is served."""
    p.rest()
    _check_items(p, _MISSION, held, _rest_of(p, _MISSION, _listed(p, _MISSION)))
    return f"answered with {described(answer)}; a new download was served"


def int_items(p: Probe) -> str:
    """MISSION_REQUEST_INT is answered with MISSION_ITEM_INT."""
    floats = [got.seq for got in _rest_of(p, _MISSION, _begun(p)[1]) if isinstance(got, m.MissionItemFloat)]
    check(not floats, f"items {floats} came as MISSION_ITEM")
    return "all as MISSION_ITEM_INT"


def int_frames(p: Probe) -> str:
    """MISSION_ITEM_INT requires the frames whose names end in INT."""
    frames = {got.frame for got in _rest_of(p, _MISSION, _begun(p)[1]) if isinstance(got, m.MissionItemInt)}
    check(frames <= set(_INT_FRAMES), f"frames {sorted(frames)}: not those of integers")
    return f"frames {sorted(frames)}"


def old_request(p: Probe) -> str:
    """MISSION_REQUEST is answered as MISSION_REQUEST_INT is."""
    _begun(p)
    answer = p.ask(m.MissionRequest(*p.to, 0, _MISSION), _MISSION, (*ITEMS, m.MissionAck))
    p.send(p.ack(MissionResult.OPERATION_CANCELLED))
    if isinstance(answer, m.MissionAck):
        raise RefusedError(f"MISSION_REQUEST was answered {described(answer)}")
    check(isinstance(answer, m.MissionItemInt), f"MISSION_REQUEST was answered with {described(answer)}")
    return "answered with MISSION_ITEM_INT"


def list_twice(p: Probe) -> str:
    """The list is requested again after its count was lost."""
    held, _ = _begun(p)
    count = _listed(p, _MISSION)
    check(count == PROBE.listed_items, f"COUNT {count} the second time")
    _check_items(p, _MISSION, held, _rest_of(p, _MISSION, count))
    return "the same count again, and every item"


def item_twice(p: Probe) -> str:
    """An item is requested again after it was lost."""
    held, count = _begun(p)
    got = []
    for seq in range(count):
        first, second = _item(p, _MISSION, seq), _item(p, _MISSION, seq)
        check(first == second, f"item {seq} differed the second time")
        got.append(second)
    p.send(p.ack(MissionResult.ACCEPTED))
    _check_items(p, _MISSION, held, got)
    return "every item twice, unchanged"


def beyond(p: Probe) -> str:
    """An item that does not exist: an error, or nothing; and the vehicle serves on."""
    held, count = _begun(p)
    p.send(m.MissionRequestInt(*p.to, count + 3, _MISSION))
    answer = p.answer(_MISSION, PROBE.answer_s / 2.0, (*ITEMS, m.MissionAck))
    check(not isinstance(answer, ITEMS), f"item {count + 3} of {count} came")
    if isinstance(answer, m.MissionAck):
        check(answer.result != MissionResult.ACCEPTED, f"item {count + 3} of {count}: ACK ACCEPTED")
    return _served_once_more(p, held, answer)


def skipping(p: Probe) -> str:
    """Item 2 before item 0; after any answer, a new download is served."""
    held, _ = _begun(p)
    p.send(m.MissionRequestInt(*p.to, 2, _MISSION))
    answer = p.answer(_MISSION, PROBE.answer_s / 2.0, (*ITEMS, m.MissionAck))
    check(not isinstance(answer, ITEMS) or seq_of(answer) == 2, f"requested item 2, received item {seq_of(answer)}")
    return _served_once_more(p, held, answer)


def _upload_taken(p: Probe) -> float:
    """Seconds until an upload is taken."""
    new = sample(_MISSION, 3, first=50)
    began = p.now()
    while p.now() - began < PROBE.free_s:
        p.forget()
        p.send(p.count(3))
        answer = p.answer(_MISSION, 0.5 + p.late_s, (*REQUESTS, m.MissionAck))
        if isinstance(answer, REQUESTS) and seq_of(answer) == 0:
            waited_s = p.now() - began
            ack = p.finish_upload(new, _MISSION)
            check(ack.result == MissionResult.ACCEPTED, f"the upload after it ended with {described(ack)}")
            return waited_s
    raise FailedError(f"no upload was accepted for {PROBE.free_s:g} s")


def abandoned(p: Probe) -> str:
    """A station that requested the list and disappeared does not block others for ever."""
    _begun(p)
    return f"an upload was accepted {_upload_taken(p):.1f} s later"


def cancelled(p: Probe) -> str:
    """A cancelled download leaves the vehicle idle."""
    _begun(p)
    _item(p, _MISSION, 0)
    p.send(p.ack(MissionResult.OPERATION_CANCELLED))
    waited_s = _upload_taken(p)
    check(waited_s < 2.0 + 4.0 * p.late_s, f"an upload was accepted {waited_s:.1f} s after ACK OPERATION_CANCELLED")
    return "an upload was accepted at once"


def slow(p: Probe) -> str:
    """A station that takes more than a second for each request."""
    held, count = _begun(p)
    got = []
    for seq in range(count):
        p.quiet(PROBE.slow_s)
        got.append(_item(p, _MISSION, seq))
    p.send(p.ack(MissionResult.ACCEPTED))
    _check_items(p, _MISSION, held, got)
    return f"served with {PROBE.slow_s:g} s between requests"


def second_station(p: Probe) -> str:
    """Another station requests the list in the middle of a download."""
    held = p.hold_sample(_MISSION, PROBE.listed_items)
    p.send(m.Heartbeat(autopilot=8, vehicle_type=6, system_status=4), as_other=True)
    count = _listed(p, _MISSION)
    got = [_item(p, _MISSION, 0)]
    p.send(m.MissionRequestList(*p.to, _MISSION), as_other=True)
    p.quiet(0.3)
    got += _rest_of(p, _MISSION, count, first=1)
    _check_items(p, _MISSION, held, got)
    return "the first station got every item"


def other_target(p: Probe) -> str:
    """Messages to another system get no answer."""
    p.hold_sample(_MISSION, PROBE.listed_items)
    p.forget()
    p.send(m.MissionRequestList(PROBE.absent_system, p.to[1], _MISSION))
    p.send(replace(m.MissionRequestInt(*p.to, 0, _MISSION), target_system=PROBE.absent_system))
    said = p.quiet(2.0)
    check(
        not said, f"a request for system {PROBE.absent_system} was answered with {described(said[0]) if said else ''}"
    )
    return "no answer"


def strange_type(p: Probe) -> str:
    """A list that does not exist is not served."""
    p.hold_sample(_MISSION, PROBE.listed_items)
    p.forget()
    p.send(m.MissionRequestList(*p.to, PROBE.strange_type))
    said = p.quiet(2.0)
    counts = [got for got in said if isinstance(got, m.MissionCount) and got.count]
    check(not counts, f"the list of mission_type {PROBE.strange_type} has {counts[0].count if counts else 0} items")
    return f"answered with {described(said[0] if said else None)}"


DOWNLOAD_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (
    *for_each_list(
        "download-in-order", "count, then each requested item", Section.DOWNLOAD, in_order,
        ("SendOutgoingMissionSendsCount", "SendOutgoingMissionSendsMissionItems",
         "DownloadMissionSendsAllMissionRequestsAndAck"),
    ),
    *for_each_list(
        "download-empty", "the count of an empty list is 0", Section.DOWNLOAD, no_items,
        ("SendOutgoingMissionEmptyMission", "DownloadMissionEmptyList"),
    ),
    ProtocolCase("download-int-items", "items are packed in MISSION_ITEM_INT", Section.DOWNLOAD, int_items),
    ProtocolCase("download-int-frames", "with frames whose names end in INT", Section.FRAMES, int_frames),
    ProtocolCase(
        "download-old-request", "MISSION_REQUEST is answered with MISSION_ITEM_INT", Section.DEPRECATED, old_request,
        ("SendOutgoingMissionNacksNonIntCase",),
    ),
    ProtocolCase(
        "download-list-twice", "a request without an answer is sent again", Section.TIMEOUTS, list_twice,
        ("DownloadMissionResendsRequestList", "SendOutgoingMissionResendsCount"),
    ),
    ProtocolCase(
        "download-item-twice", "the same for an item", Section.TIMEOUTS, item_twice,
        ("SendOutgoingMissionResendsMissionItems", "DownloadMissionResendsRequestItemAgainForSecondItem"),
    ),
    ProtocolCase("download-beyond-count", "an error can answer any request", Section.ERRORS, beyond),
    ProtocolCase("download-skipping", "out-of-sequence messages are recoverable", Section.ERRORS, skipping),
    ProtocolCase(
        "download-abandoned", "back to idle when the other side falls silent", Section.TIMEOUTS, abandoned,
        ("SendOutgoingMissionTimeoutAfterSendCount",),
    ),
    ProtocolCase(
        "download-cancelled", "OPERATION_CANCELLED: both sides go idle", Section.CANCEL, cancelled,
        ("SendOutgoingMissionCanBeCancelled", "DownloadMissionCanBeCancelled"),
    ),
    ProtocolCase(
        "download-slow", "time-outs are not errors", Section.ERRORS, slow,
        ("SendOutgoingMissionTimeoutNotTriggeredDuringTransfer", "DownloadMissionTimeoutNotTriggeredDuringTransfer"),
    ),
    ProtocolCase("download-second-station", "each station's operation is its own", Section.DOWNLOAD, second_station),
    ProtocolCase("download-other-target", "a message is for the system that it names", Section.ROUTING, other_target),
    ProtocolCase("download-strange-type", "mission_type is mission, fence or rally", Section.TYPES, strange_type),
)  # fmt: skip
