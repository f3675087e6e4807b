"""A ground station that sends a vehicle one message at a time on its link's clock, for the cases."""

from collections import deque
from collections.abc import Callable, Sequence

from mission_io.client.client import Client
from mission_io.client.peers import VehicleInfo
from mission_io.conformance.case import (
    ITEMS,
    LIST_NAMES,
    PROBE,
    PROTOCOL,
    REQUESTS,
    FailedError,
    LackingError,
    RefusedError,
    check,
    difference,
    sample,
)
from mission_io.errors import FormatError, TransferError, TransferSilentError
from mission_io.links.datagrams import Link
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.timing import Timing
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from mission_io.wire.message_table import BY_CLASS
from mission_io.wire.messages import Address, message_from_item


class Probe:
    """Speaks to one vehicle as a ground station, and where a case wants it as a second one.

    Args:
        link: To the vehicle; its clock is the time.
        system_id: This side's system.

    Attributes:
        client: The whole client, for what a case needs and does not judge.
    """

    def __init__(self, link: Link, *, system_id: int = 255) -> None:
        self.client = Client(link, system_id=system_id, listener=self._note, timing=Timing(items_ahead=0))
        self._other = Codec(system_id=PROBE.other_system if system_id != PROBE.other_system else 253, component_id=190)
        self._inbox: deque[m.Received] = deque()
        self._served: tuple[int, int] | None = None
        self._served_at = self._late_s = 0.0

    @property
    def vehicle(self) -> VehicleInfo:
        """The vehicle as of its latest heartbeat."""
        return self.client.vehicle

    @property
    def other(self) -> Address:
        """The second ground station."""
        return Address(self._other.system_id, self._other.component_id)

    @property
    def home_first(self) -> bool:
        """Whether item 0 of a mission is the vehicle's own home."""
        autopilot = self.client.known_autopilot
        return autopilot is not None and autopilot.home_in_item_0

    def now(self) -> float:
        """The time of the link's clock, in seconds."""
        return self.client.clock.now()

    def _note(self, received: m.Received, now: float) -> None:
        del now
        self._inbox.append(received)

    # One message at a time.

    @property
    def to(self) -> tuple[int, int]:
        """The vehicle's address, as the first two fields of a message."""
        return self.vehicle.address

    def send(self, message: m.Message, *, as_other: bool = False) -> None:
        """Send one message, as this station or as the second one."""
        if as_other:
            self.client.link.send(self._other.encode(message))
            return
        self.client.send(message)
        if isinstance(message, ITEMS):
            self._served, self._served_at = (message.seq, message.mission_type), self.now()

    @property
    def late_s(self) -> float:
        """The longest expected delay of an answer on this link, from the slowest transfer so far."""
        round_trip = self.client.retry_limits.round_trip
        if round_trip is not None:
            self._late_s = max(self._late_s, min(PROBE.longest_late_s, round_trip.time_out_s))
        return self._late_s or PROBE.unmeasured_s

    def count(self, count: int, mission_type: int = MissionType.MISSION) -> m.MissionCount:
        """Announces an upload."""
        return m.MissionCount(*self.to, count, mission_type)

    def item(
        self, items: Sequence[MissionItem], seq: int, mission_type: MissionType = MissionType.MISSION
    ) -> m.MissionItemInt:
        """Item ``seq`` of a list."""
        system, component = self.to
        return message_from_item(
            items[seq], seq, mission_type=mission_type, target_system=system, target_component=component
        )

    def ack(self, result: MissionResult, mission_type: int = MissionType.MISSION) -> m.MissionAck:
        """Ends something."""
        return m.MissionAck(*self.to, result, mission_type)

    def forget(self) -> None:
        """Discard all messages so far and those still under way, so that none answers a later question."""
        self.hear(lambda _: False, self.late_s)
        self._inbox.clear()
        self._served = None

    def hear(
        self, accept: Callable[[m.Message], bool], within_s: float = PROBE.answer_s, *, any_target: bool = False
    ) -> m.Message | None:
        """The vehicle's next message that ``accept`` takes; None without one within ``within_s`` seconds.

        Messages to others are skipped unless ``any_target``.
        """
        deadline = self.now() + within_s
        local = self.client.local._asdict()
        while True:
            while self._inbox:
                received = self._inbox.popleft()
                if received.sender != self.vehicle.address:
                    continue
                if (any_target or m.is_for(received.message, **local)) and accept(received.message):
                    return received.message
            if self.now() >= deadline:
                return None
            self.client.poll(min(0.05, max(0.0, deadline - self.now())))

    def answer(
        self, mission_type: int, within_s: float = PROBE.answer_s, kinds: tuple[type[m.Message], ...] = PROTOCOL
    ) -> m.Message | None:
        """The next message of the mission protocol to this station about a list.

        A request for the item that was sent last, or for one before it, is no answer to it while that may be under way.
        """

        def accept(message: m.Message) -> bool:
            about = getattr(message, "mission_type", None)
            if not isinstance(message, kinds) or about != mission_type:
                return False
            served = self._served
            crossed = (
                isinstance(message, REQUESTS) and served is not None and served[1] == about and message.seq <= served[0]
            )
            return not (crossed and self.now() - self._served_at < self.late_s)

        return self.hear(accept, within_s)

    def ask(
        self,
        message: m.Message,
        mission_type: int,
        kinds: tuple[type[m.Message], ...] = PROTOCOL,
        tries: int = PROBE.tries,
    ) -> m.Message | None:
        """Send, again after each silence, and return the answer; None after the last try."""
        for _ in range(tries):
            self.send(message)
            answer = self.answer(mission_type, PROBE.answer_s / 2.0, kinds)
            if answer is not None:
                return answer
        return None

    def begin_upload(self, count: int, mission_type: MissionType) -> None:
        """Announce an upload and wait for the request of item 0.

        Raises:
            RefusedError: the vehicle answers with an error.
            FailedError: it answers with something else, or not at all.
        """
        self.forget()
        answer = self.ask(self.count(count, mission_type), mission_type, (*REQUESTS, m.MissionAck))
        if isinstance(answer, m.MissionAck):
            check(answer.result != MissionResult.ACCEPTED, f"COUNT {count} was answered ACK ACCEPTED")
            raise RefusedError(f"COUNT {count} was answered {result_name(answer.result)}")
        check(answer is not None, f"COUNT {count} was not answered")
        check(seq_of(answer) == 0, f"it requested item {seq_of(answer)} first")

    def begin_new(self, count: int) -> tuple[MissionItem, ...]:
        """Begin to upload a mission that ``hold_sample`` does not give; it. Errors as ``begin_upload``."""
        new = sample(MissionType.MISSION, count, first=PROBE.new_items)
        self.begin_upload(count, MissionType.MISSION)
        return new

    def finish_upload(
        self, items: Sequence[MissionItem], mission_type: MissionType, *, first: int = 0, wait_s: float = PROBE.answer_s
    ) -> m.MissionAck:
        """Serve the vehicle's requests, from item ``first`` which it has just requested, until it acknowledges.

        Raises:
            FailedError: it falls silent, or asks for what does not exist.
        """
        self.send(self.item(items, first, mission_type))
        for _ in range(20 * len(items) + 40):
            answer = self.answer(mission_type, wait_s, (*REQUESTS, m.MissionAck))
            if isinstance(answer, m.MissionAck) and answer.result == MissionResult.INVALID_SEQUENCE:
                continue  # about an item that it asked for twice; another case judges that
            if isinstance(answer, m.MissionAck):
                return answer
            check(answer is not None, f"no message arrived within {wait_s:g} s of an item")
            seq = seq_of(answer)
            check(seq < len(items), f"it requested item {seq} of {len(items)}")
            self.send(self.item(items, seq, mission_type))
        raise FailedError("it requested items repeatedly and never acknowledged")

    # Whole lists, which the case does not judge.

    def hold(self, mission_type: MissionType, items: Sequence[MissionItem]) -> None:
        """Make the vehicle hold a list, by every means of the client.

        Raises:
            RefusedError: it does not take it.
            FailedError: it takes it and does not hold it, or gets nowhere.
            LackingError: it does not answer.
        """
        try:
            if items:
                self.client.upload(mission_type, items)
            else:
                self.client.clear(mission_type)
        except TransferSilentError as error:
            raise LackingError(f"no answer about {LIST_NAMES[mission_type]}: {error}") from None
        except TransferError as error:
            raise (FailedError if error.refusal is None else RefusedError)(str(error)) from None
        self.forget()

    def hold_sample(self, mission_type: MissionType, count: int) -> tuple[MissionItem, ...]:
        """Make the vehicle hold ``count`` items; them."""
        items = sample(mission_type, count)
        self.hold(mission_type, items)
        return items

    def held(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """The list that the vehicle holds. Raises FailedError: it cannot be read."""
        try:
            items = self.client.download(mission_type)
        except (TransferError, FormatError) as error:
            raise FailedError(f"the vehicle's {LIST_NAMES[mission_type]} cannot be read: {error}") from None
        self.forget()
        return items

    def check_held(self, mission_type: MissionType, items: Sequence[MissionItem], what: str) -> None:
        """Go on only if the vehicle holds a list; ``what`` names it. Raises FailedError: it holds something else."""
        home_first = self.home_first and mission_type is MissionType.MISSION
        seen = ""
        for wait_s in (0.0, 0.3):  # what was read back at once may be of before: see Client.upload_and_verify
            self.quiet(wait_s)
            held = self.held(mission_type)
            seen = difference(items, held[1:] if home_first and not items else held, home_first=home_first)
            if not seen:
                return
        raise FailedError(f"{what}: {seen}")

    def quiet(self, seconds: float) -> list[m.Message]:
        """Let time pass; return the vehicle's messages in the mission protocol meanwhile, to any recipient."""
        said: list[m.Message] = []
        deadline = self.now() + seconds
        while (left := deadline - self.now()) > 0.0:
            message = self.hear(lambda got: isinstance(got, PROTOCOL), left, any_target=True)
            if message is not None:
                said.append(message)
        return said

    def rest(self) -> float:
        """Bring the vehicle back to idle: end its transfers, and wait until it is silent. Returns the seconds taken."""
        began = self.now()
        while self.now() - began < PROBE.longest_rest_s:
            said = self.quiet(PROBE.idle_s)
            if not said:
                break
            requested = [message for message in said if isinstance(message, REQUESTS)]
            if not requested:
                continue
            last = requested[-1]
            self.send(
                self.ack(MissionResult.OPERATION_CANCELLED, last.mission_type),
                as_other=last.target_system == self.other.system_id,
            )
        self.forget()
        return self.now() - began

    def reads_list(self, mission_type: MissionType) -> bool:
        """Whether the vehicle answers a request for this list."""
        request = m.MissionRequestList(*self.to, mission_type)
        answer = self.ask(request, mission_type, (m.MissionCount, m.MissionAck))
        if isinstance(answer, m.MissionCount):
            self.send(self.ack(MissionResult.ACCEPTED, mission_type))
        return isinstance(answer, m.MissionCount)


def seq_of(message: m.Message | None) -> int:
    """The item that a message is about; -1 for none."""
    seq: int = getattr(message, "seq", -1)
    return seq


def result_name(result: int) -> str:
    """The name of a MAV_MISSION_RESULT, or its number."""
    return MissionResult(result).name if result in MissionResult._value2member_map_ else str(result)


def described(message: m.Message | None) -> str:
    """A message of the protocol in a few words."""
    if message is None:
        return "nothing"
    if isinstance(message, m.MissionAck):
        return f"ACK {result_name(message.result)}"
    if isinstance(message, m.MissionCount):
        return f"COUNT {message.count}"
    if isinstance(message, (*REQUESTS, *ITEMS)):
        return f"{BY_CLASS[type(message)].layout.name.upper()} {message.seq}"
    return type(message).__name__
