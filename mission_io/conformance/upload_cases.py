"""Cases for a vehicle that receives an upload: order, repetition, lost, repeated and late messages."""

from dataclasses import replace
from functools import partial
from typing import Final

from mission_io.conformance.case import (
    PROBE,
    REQUESTS,
    STATION,
    FailedError,
    LackingError,
    ProtocolCase,
    RefusedError,
    Section,
    check,
    for_each_list,
    sample,
)
from mission_io.conformance.probe import Probe, described, result_name, seq_of
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.messages import Message, MissionAck, MissionRequest, float_message

_MISSION: Final = MissionType.MISSION


def accepted(p: Probe, ack: Message | None, otherwise: str = "no ACK") -> None:
    """Go on only if a message accepts an upload; ``otherwise`` is what was seen where it is no acknowledgement."""
    if not isinstance(ack, MissionAck):
        raise FailedError(otherwise)
    if ack.result in (MissionResult.UNSUPPORTED, MissionResult.UNSUPPORTED_FRAME, MissionResult.DENIED):
        raise RefusedError(f"ACK {result_name(ack.result)}")
    check(ack.result == MissionResult.ACCEPTED, f"ACK {result_name(ack.result)}")
    check(ack.target_system == p.client.local.system_id, f"the ACK is for system {ack.target_system}")


def finished(p: Probe, new: tuple[MissionItem, ...], what: str, first: int = 0, wait_s: float = PROBE.answer_s) -> None:
    """Go on only if the rest of a mission is accepted, and held; ``what`` names it."""
    accepted(p, p.finish_upload(new, _MISSION, first=first, wait_s=wait_s))
    p.check_held(_MISSION, new, what)


def last_ack(p: Probe, wait_s: float) -> Message | None:
    """The final acknowledgement, without those of single items that came twice."""
    while True:
        ack = p.answer(_MISSION, wait_s, (MissionAck,))
        if not (isinstance(ack, MissionAck) and ack.result == MissionResult.INVALID_SEQUENCE):
            return ack


def begin_three(p: Probe, t: MissionType) -> None:
    """Begin an upload of five items in place of seven, up to the request for the fourth."""
    new = sample(t, PROBE.few_items, first=PROBE.new_items)
    p.begin_upload(len(new), t)
    for seq in range(3):
        p.send(p.item(new, seq, t))
        answer = p.answer(t)
        if isinstance(answer, MissionAck):
            raise RefusedError(f"item {seq} was answered with {described(answer)}")
        check(seq_of(answer) == seq + 1, f"item {seq} was followed by {described(answer)}")


def in_order(t: MissionType, p: Probe) -> str:
    """Items are requested from 0 on, one by one, and then there is one ACK."""
    new = sample(t, PROBE.few_items, first=PROBE.new_items)
    p.hold_sample(t, 3)
    p.begin_upload(len(new), t)
    for seq in range(len(new)):
        p.send(p.item(new, seq, t))
        answer = p.answer(t)
        if seq + 1 == len(new):
            accepted(p, answer, f"the last item was answered with {described(answer)}")
        else:
            if isinstance(answer, MissionAck):
                raise RefusedError(f"item {seq} was answered with {described(answer)}")
            check(isinstance(answer, REQUESTS) and seq_of(answer) == seq + 1, f"after item {seq}: {described(answer)}")
    again = [described(m) for m in p.quiet(2.0 * STATION.item_resend_s)]
    check(not again, f"after the ACK it sent {', '.join(again)}")
    p.check_held(t, new, "what it holds")
    return f"requested 0 to {len(new) - 1}, sent one ACK, read back equal"


def shorter(p: Probe) -> str:
    """A shorter list replaces a longer one wholly."""
    p.hold_sample(_MISSION, 7)
    new = p.begin_new(3)
    finished(p, new, "after 3 items in place of 7")
    return "3 items in place of 7"


def hundred(p: Probe) -> str:
    """A longer list."""
    new = p.begin_new(100)
    began = p.now()
    accepted(p, p.finish_upload(new, _MISSION))
    took_s = p.now() - began
    p.check_held(_MISSION, new, "100 items")
    return f"100 items in {took_s:.1f} s"


def first_item(p: Probe) -> str:
    """Sequence number 0 is the first item of the list."""
    new = sample(_MISSION, 3, first=PROBE.new_items)
    p.hold(_MISSION, new)
    held = p.held(_MISSION)
    check(len(held) == 3, f"{len(held)} items in place of 3")
    same = abs(held[0].lat_deg - new[0].lat_deg) < 1e-6 and abs(held[0].lon_deg - new[0].lon_deg) < 1e-6
    check(same, f"item 0 came back at {held[0].lat_deg:.7f}, {held[0].lon_deg:.7f}: this is its own home")
    return "item 0 came back"


def int_requests(p: Probe) -> str:
    """It asks with MISSION_REQUEST_INT."""
    p.forget()
    answer = p.ask(p.count(3), _MISSION)
    p.send(p.ack(MissionResult.OPERATION_CANCELLED))
    if isinstance(answer, MissionAck):
        raise RefusedError(described(answer))
    check(not isinstance(answer, MissionRequest), "requested with the deprecated MISSION_REQUEST")
    check(answer is not None, "COUNT was not answered")
    return f"requested with {described(answer)}"


def asks_again(at: int, p: Probe) -> str:
    """The vehicle requests an item again that does not come."""
    t = _MISSION
    new = p.begin_new(3)
    for seq in range(at):
        p.send(p.item(new, seq, t))
        answer = p.answer(t)
        check(seq_of(answer) == seq + 1, f"after item {seq}: {described(answer)}")
    began = p.now()
    answer = p.answer(t, 2.0 * PROBE.answer_s)
    took_s = p.now() - began
    check(isinstance(answer, REQUESTS) and seq_of(answer) == at, f"in {took_s:.1f} s of silence: {described(answer)}")
    accepted(p, p.finish_upload(new, t, first=at))
    return f"requested again after {took_s:.2f} s"


def gives_up(t: MissionType, p: Probe) -> str:
    """A station that falls silent is given up, and the old list stays."""
    old = p.hold_sample(t, 7)
    begin_three(p, t)
    began, last_s, count = p.now(), 0.0, 0
    while (left := PROBE.gives_up_s - (p.now() - began)) > 0.0:
        answer = p.answer(t, min(left, 2.0 * PROBE.answer_s))
        if isinstance(answer, REQUESTS):
            last_s, count = p.now() - began, count + 1
        elif answer is None and p.now() - began - last_s >= 2.0 * PROBE.answer_s - 0.1:
            break
    check(last_s < PROBE.gives_up_s - 2.0 * PROBE.answer_s, f"still requested items after {last_s:.0f} s of silence")
    p.check_held(t, old, f"the old list after {count} requests in {last_s:.1f} s")
    return f"stopped after {count} requests in {last_s:.1f} s, old list unchanged"


def new_one_after_silence(p: Probe) -> str:
    """A new upload is taken after one that fell silent."""
    p.begin_upload(PROBE.few_items, _MISSION)
    p.quiet(2.0)
    new = sample(_MISSION, 3, first=PROBE.new_items)
    began = p.now()
    while p.now() - began < PROBE.gives_up_s:
        p.forget()
        p.send(p.count(3))
        answer = p.answer(_MISSION, STATION.resend_s)
        if isinstance(answer, REQUESTS) and seq_of(answer) == 0:
            ack = p.finish_upload(new, _MISSION)
            if ack.result == MissionResult.ACCEPTED:
                waited_s = p.now() - began
                p.check_held(_MISSION, new, "the new list")
                return f"accepted {waited_s:.1f} s later"
    raise FailedError(f"no new upload was accepted in {PROBE.gives_up_s:g} s")


def twice(p: Probe) -> str:
    """Every item is sent twice."""
    new = p.begin_new(PROBE.few_items)
    for seq in range(len(new)):
        for _ in range(2):
            p.send(p.item(new, seq))
    ack = last_ack(p, PROBE.answer_s)
    if not (isinstance(ack, MissionAck) and ack.result == MissionResult.ACCEPTED):
        raise FailedError(f"each item sent twice: {described(ack)}")
    p.quiet(1.0)
    p.check_held(_MISSION, new, "after every item was sent twice")
    return "accepted, no item twice"


def out_of_order(p: Probe) -> str:
    """An item out of sequence is dropped, and the right one requested again."""
    new = p.begin_new(4)
    p.send(p.item(new, 2))
    answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    check(isinstance(answer, REQUESTS), f"item 2 in place of 0 was answered with {described(answer)}")
    check(seq_of(answer) == 0, f"item 2 in place of 0: requested {seq_of(answer)}")
    finished(p, new, "after an item out of order")
    return "requested 0 again"


def beyond(p: Probe) -> str:
    """An item that was not announced is dropped."""
    new = sample(_MISSION, 6, first=PROBE.new_items)
    p.begin_upload(3, _MISSION)
    p.send(p.item(new, 5))
    answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    said = described(answer)
    if isinstance(answer, MissionAck):
        check(answer.result != MissionResult.ACCEPTED, "item 5 of 3 was accepted")
        answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    check(isinstance(answer, REQUESTS) and seq_of(answer) == 0, f"item 5 of 3: {said}, then {described(answer)}")
    finished(p, new[:3], "after an item beyond the count")
    return f"{said}, and the upload continued"


def count_twice(p: Probe) -> str:
    """The same COUNT twice, as after a lost answer."""
    new = sample(_MISSION, PROBE.few_items, first=PROBE.new_items)
    p.forget()
    p.send(p.count(len(new)))
    p.begin_upload(len(new), _MISSION)
    accepted(p, p.finish_upload(new, _MISSION))
    p.quiet(1.0)
    p.check_held(_MISSION, new, "after COUNT was sent twice")
    return "accepted once, list right"


def count_late(p: Probe) -> str:
    """The same COUNT again in the middle, as a late duplicate does."""
    new = p.begin_new(PROBE.few_items)
    for seq in range(2):
        p.send(p.item(new, seq))
        check(seq_of(p.answer(_MISSION)) == seq + 1, f"item {seq} was not followed by the next request")
    p.send(p.count(len(new)))
    answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    late = None if isinstance(answer, MissionAck) else p.answer(_MISSION, p.late_s, (MissionAck,))
    said = described(late or answer)
    if isinstance(answer, MissionAck):
        answer = p.answer(_MISSION, 2.0 * PROBE.answer_s)
    check(isinstance(answer, REQUESTS), f"COUNT at item 2: {said}, then {described(answer)}")
    finished(p, new, "after a late COUNT", first=seq_of(answer))
    return f"{said}, then continued with item {seq_of(answer)}"


def last_again(p: Probe) -> str:
    """The last item again after the end, as when the ACK was lost."""
    new = p.begin_new(3)
    accepted(p, p.finish_upload(new, _MISSION))
    p.send(p.item(new, 2))
    said = described(p.answer(_MISSION, STATION.resend_s))
    p.rest()
    p.check_held(_MISSION, new, f"after the last item again ({said})")
    return f"answered with {said}, list unchanged"


def slow(p: Probe) -> str:
    """A station that takes more than a second for each item."""
    new = p.begin_new(4)
    for seq in range(4):
        p.quiet(PROBE.slow_s)
        p.forget()
        p.send(p.item(new, seq))
    accepted(p, last_ack(p, 2.0 * PROBE.answer_s))
    p.check_held(_MISSION, new, "after a slow upload")
    return f"accepted with {PROBE.slow_s:g} s an item"


def float_items(p: Probe) -> str:
    """Items in the deprecated MISSION_ITEM."""
    new = p.begin_new(3)
    answer = None
    for seq in range(3):
        p.send(replace(float_message(p.item(new, seq)), frame=int(new[seq].frame)))
        answer = p.answer(_MISSION)
        if isinstance(answer, MissionAck):
            break
    if isinstance(answer, MissionAck) and answer.result == MissionResult.ACCEPTED and seq == 2:
        held = p.held(_MISSION)
        near = all(abs(a.lat_deg - b.lat_deg) < 1e-5 for a, b in list(zip(new, held, strict=False))[1:])
        check(len(held) == 3 and near, "accepted, but the list differs")
        return "accepted, within the precision of a float"
    if isinstance(answer, MissionAck):
        raise RefusedError(f"item {seq} was answered with {described(answer)}")
    raise LackingError(f"MISSION_ITEM was answered with {described(answer)}")


UPLOAD_CASES: Final[tuple[ProtocolCase[Probe], ...]] = (
    *for_each_list(
        "upload-in-order", "item 0 first, each after the one before has arrived, then one ACK", Section.UPLOAD, in_order,
        ("ReceiveIncomingMissionSendsMissionRequests", "UploadMissionSendsCount", "UploadMissionSendsMissionItems"),
    ),
    *for_each_list(
        "upload-silence", "after some retries the operation is cancelled; the old list stays until a new one is whole",
        Section.TIMEOUTS, gives_up,
        ("ReceiveIncomingMissionResendsMissionRequestsAndTimesOutEventually", "UploadMissionTimeoutAfterSendMissionItem"),
    ),
    ProtocolCase("upload-shorter", "the new mission becomes the mission, the original is discarded", Section.UPLOAD, shorter),
    ProtocolCase("upload-100", "the cycle continues until all items have arrived", Section.UPLOAD, hundred),
    ProtocolCase("upload-first-item", "items are numbered from 0; none of them is home", Section.ITEMS, first_item),
    ProtocolCase(
        "upload-int-requests", "MISSION_REQUEST is deprecated and not to be sent", Section.DEPRECATED, int_requests,
        ("UploadMissionNacksNonIntCase", "IntMessagesNotSupported"),
    ),
    ProtocolCase(
        "upload-item-lost", "a request that is not answered in time is sent again", Section.TIMEOUTS, partial(asks_again, 0),
        ("UploadMissionResendsMissionItems",),
    ),
    ProtocolCase(
        "upload-second-item-lost", "the same for every item", Section.TIMEOUTS, partial(asks_again, 1),
        ("ReceiveIncomingMissionResendsRequestItemAgainForSecondItem",),
    ),
    ProtocolCase(
        "upload-after-silence", "back to idle when the other side falls silent", Section.TIMEOUTS, new_one_after_silence,
    ),
    ProtocolCase("upload-items-twice", "out-of-sequence items are dropped without an error", Section.ERRORS, twice),
    ProtocolCase("upload-out-of-order", "the item is dropped, the expected one requested again", Section.UPLOAD, out_of_order),
    ProtocolCase("upload-beyond-count", "the same for an item that was not announced", Section.UPLOAD, beyond),
    ProtocolCase(
        "upload-count-twice", "a message without an answer is sent again, so it may arrive twice", Section.TIMEOUTS,
        count_twice, ("UploadMissionResendsCount", "UploadMissionTimeoutAfterSendCount"),
    ),
    ProtocolCase("upload-count-late", "the same in the middle of the upload", Section.TIMEOUTS, count_late),
    ProtocolCase(
        "upload-last-item-again", "an idle vehicle may answer with an error; the list stays", Section.CANCEL, last_again
    ),
    ProtocolCase(
        "upload-slow", "time-outs are not errors", Section.ERRORS, slow,
        ("UploadMissionTimeoutNotTriggeredDuringTransfer",),
    ),
    ProtocolCase("upload-float-items", "MISSION_ITEM must be accepted, too", Section.UPLOAD, float_items),
)  # fmt: skip
