"""Cases for clearing, the current item, a vehicle's stated capabilities, and the ids of its lists."""

from typing import Final

from mission_io.conformance.case import FailedError, LackingError, ProtocolCase, RefusedError, check, for_each_list
from mission_io.conformance.guide import Section
from mission_io.conformance.probe import Probe, described
from mission_io.conformance.samples import LIST_NAMES, sample
from mission_io.conformance.tuning import PROBE
from mission_io.conformance.upload_cases import accepted
from mission_io.model.enums import MissionResult
from mission_io.model.items import ALL_MISSION_TYPES, Command, MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id

_MISSION: Final = MissionType.MISSION
_CAN_INT: Final = 1 << 2
_CAN: Final = {MissionType.FENCE: 1 << 14, MissionType.RALLY: 1 << 15}


def cleared(t: MissionType, p: Probe) -> str:
    """CLEAR_ALL empties a list."""
    p.hold(t, sample(t, 4))
    answer = p.ask(m.MissionClearAll(*p.to, t), t, (m.MissionAck,))
    check(isinstance(answer, m.MissionAck), "CLEAR_ALL was not answered")
    if isinstance(answer, m.MissionAck):
        accepted(p, answer)
    p.check_held(t, (), "after CLEAR_ALL")
    return "accepted, list empty"


def cleared_twice(p: Probe) -> str:
    """A list that is empty already."""
    p.hold(_MISSION, ())
    for _ in range(2):
        answer = p.ask(m.MissionClearAll(*p.to, _MISSION), _MISSION, (m.MissionAck,))
        check(isinstance(answer, m.MissionAck), "CLEAR_ALL of an empty list was not answered")
        if isinstance(answer, m.MissionAck):
            accepted(p, answer)
    return "accepted each time"


def cleared_alone(p: Probe) -> str:
    """Clearing one list leaves the others."""
    kept = [t for t in (MissionType.FENCE, MissionType.RALLY) if p.reads_list(t)]
    if not kept:
        raise LackingError("it has only a mission")
    for t in kept:
        p.hold(t, sample(t, 4))
    p.ask(m.MissionClearAll(*p.to, _MISSION), _MISSION, (m.MissionAck,))
    p.rest()
    for t in kept:
        p.check_held(t, sample(t, 4), f"the {LIST_NAMES[t]} after the mission was cleared")
    return f"{', '.join(LIST_NAMES[t] for t in kept)} unchanged"


def cleared_all(p: Probe) -> str:
    """mission_type 255 empties all three."""
    kept = [t for t in MissionType if t is _MISSION or p.reads_list(t)]
    for t in kept:
        p.hold(t, sample(t, 4))
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


def _current(p: Probe, within_s: float = PROBE.current_s, seq: int | None = None) -> m.MissionCurrent | None:
    found = p.hear(lambda got: isinstance(got, m.MissionCurrent) and seq in (None, got.seq), within_s)
    return found if isinstance(found, m.MissionCurrent) else None


def _asked_for_current(p: Probe) -> None:
    """Some vehicles send MISSION_CURRENT only to those who want it."""
    interval = (float(message_id(m.MissionCurrent)), 500_000.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    p.send(m.CommandLong(*p.to, Command.SET_MESSAGE_INTERVAL, interval))


def current_set(p: Probe) -> str:
    """MISSION_SET_CURRENT is followed by MISSION_CURRENT with that number."""
    p.hold(_MISSION, sample(_MISSION, 5))
    _asked_for_current(p)
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
    p.hold(_MISSION, sample(_MISSION, 3))
    _asked_for_current(p)
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
    p.hold(_MISSION, sample(_MISSION, 3))
    _asked_for_current(p)
    current = _current(p)
    if current is None:
        raise FailedError("it sends no MISSION_CURRENT, also when asked to")
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
    _asked_for_current(p)
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
    asked = (float(message_id(m.AutopilotVersion)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    version = None
    for _ in range(3):
        p.forget()
        p.send(m.CommandLong(*p.to, Command.REQUEST_MESSAGE, asked))
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
