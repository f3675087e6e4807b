"""Judges of a ground station: its messages, their order and times, and its report to the user."""

from collections.abc import Callable

from mission_io.conformance.case import ITEMS, REQUESTS, FailedError, LackingError, check, difference
from mission_io.conformance.evidence import HeardMessage, Operation, StationEvidence
from mission_io.conformance.probe import result_name
from mission_io.conformance.tuning import STATION
from mission_io.model.enums import MissionResult
from mission_io.wire import messages as m
from mission_io.wire.mission_items import item_from_message

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
    """The difference between what the station sent and what the vehicle holds; empty when there is none."""
    sent = {_seq(h.message): h.message for h in e.of(*ITEMS)}
    return difference([item_from_message(got) for _, got in sorted(sent.items()) if isinstance(got, ITEMS)], e.held)


def _download_completes(e: StationEvidence) -> str:
    asked = {_seq(h.message) for h in e.of(*REQUESTS)}
    missing = set(range(len(e.old))) - asked
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


def only_what_is_asked(e: StationEvidence) -> str:
    """Each item answers a request."""
    for h in e.of(*ITEMS):
        seq = _seq(h.message)
        asked = any(_seq(q.message) == seq and q.at_s <= h.at_s for q in e.answered(*REQUESTS))
        check(asked, f"item {seq} was sent before its request")
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
