"""Reading and setting parameters as state machines: all of them, some by name, and setting with confirmation.

The same machines serve the parameters of autopilots (PARAM_*) and the extended ones of other components (PARAM_EXT_*); what the
messages of each look like is in ``ParameterMessages``. Lost values are requested again by name or index, at most ``window``
at once, so that neither a long list nor a flood of answers makes this side flood the link.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from mission_io.protocol.parameter_values import (
    Parameter,
    Value,
    bytes_of_value,
    float_of_value,
    same_value,
    value_of_bytes,
    value_of_float,
)
from mission_io.protocol.timing import VALUES
from mission_io.wire import messages as m
from mission_io.wire.messages import Address

# Meaning of messages about parameters: autopilots' (PARAM_*) and extended ones (PARAM_EXT_*).

_ACCEPTED, _IN_PROGRESS = 0, 3
"""PARAM_ACK numbers."""
_REASONS = {1: "unsupported value", 2: "failed"}
_ERRORS = {1: "does not exist", 2: "value out of range", 3: "permission denied", 4: "no such component", 5: "read only",
           6: "unsupported type", 7: "type mismatch", 8: "cannot be read"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Heard:
    """Content of a message about parameters."""

    name: str  # which one
    parameter: Parameter | None  # its value; None when the message refuses
    count: int = 0  # how many there are; 0 where the message does not say
    refused: str = ""  # why there is no value, or why it was not set; empty for a value
    in_progress: bool = False  # whether the component is still setting it


class ParameterMessages:
    """The messages about parameters, to and from one component.

    Args:
        to: The component.
        bytewise: Whether it sends the bits of an integer as if they were a float, or casts it.
        extended: Whether it has extended parameters.
    """

    def __init__(self, to: Address, *, bytewise: bool = False, extended: bool = False) -> None:
        self.to, self.bytewise, self.extended = to, bytewise, extended

    def list_request(self) -> m.Message:
        """Asks for all."""
        kind = m.ParamExtRequestList if self.extended else m.ParamRequestList
        return kind(*self.to)

    def read_request(self, name: str, index: int = -1) -> m.Message:
        """Asks for one, by name or by index."""
        kind = m.ParamExtRequestRead if self.extended else m.ParamRequestRead
        return kind(*self.to, name, index)

    def set_request(self, name: str, value: Value, param_type: int) -> m.Message:
        """Asks to set one. Raises MisuseError: the value does not fit the type."""
        if self.extended:
            return m.ParamExtSet(*self.to, name, bytes_of_value(value, param_type, name=name), param_type)
        number = float("nan") if isinstance(value, bytes) else value
        wire = float_of_value(number, param_type, bytewise=self.bytewise, name=name)
        return m.ParamSet(*self.to, name, wire, param_type)

    def heard(self, received: m.Received) -> Heard | None:
        """Content of a message about parameters of this component; None for other messages."""
        if received.sender != self.to:
            return None
        match received.message:
            case m.ParamValue(name, wire, param_type, count, index) if not self.extended:
                value: Value = value_of_float(wire, param_type, bytewise=self.bytewise)
            case m.ParamExtValue(name, raw, param_type, count, index) if self.extended:
                value = value_of_bytes(raw, param_type)
            case m.ParamError(name=name, error=error) if not self.extended:
                return Heard(name, None, refused=_ERRORS.get(error, f"error {error}"))
            case m.ParamExtAck(name, raw, param_type, result) if self.extended:
                if result not in (_ACCEPTED, _IN_PROGRESS):
                    return Heard(name, None, refused=_REASONS.get(result, f"result {result}"))
                parameter = Parameter(name, value_of_bytes(raw, param_type), param_type)
                return Heard(name, parameter, in_progress=result == _IN_PROGRESS)
            case _:
                return None
        return Heard(name, Parameter(name, value, param_type, None if index == 0xFFFF else index), count)


KeyT = TypeVar("KeyT", int, str)


class _Asking(Generic[KeyT]):
    """Outstanding requests: each is repeated after a silence, at most ``window`` at once."""

    def __init__(self, keys: Iterable[KeyT], *, window: int, again_s: float) -> None:
        self.left: dict[KeyT, None] = dict.fromkeys(keys)
        self._window, self._again_s = window, again_s
        self._asked_at: dict[KeyT, float] = {}

    def due(self, now: float) -> list[KeyT]:
        """Requests due now."""
        found: list[KeyT] = []
        waiting = 0
        for key in self.left:
            asked_at = self._asked_at.get(key)
            if asked_at is not None and now < asked_at + self._again_s:
                waiting += 1
            elif waiting + len(found) < self._window:
                found.append(key)
            if waiting + len(found) >= self._window:
                break
        self._asked_at.update(dict.fromkeys(found, now))
        return found

    def next_timer(self) -> float | None:
        """When the next is due; None while nothing is asked."""
        return min(self._asked_at.values()) + self._again_s if self._asked_at else None

    def answered(self, key: KeyT) -> bool:
        """Whether this was requested; removes the request."""
        self._asked_at.pop(key, None)
        if key not in self.left:
            return False
        del self.left[key]
        return True

    def wait_longer(self, key: KeyT, now: float) -> None:
        """Ask for this again only after another silence from now on."""
        if key in self._asked_at:
            self._asked_at[key] = now


class ParameterDownload:
    """All parameters of a component.

    The list is requested, repeatedly until the first one comes. When it runs dry, the missing ones are requested by
    their index.

    Args:
        messages: The component's messages.
        now: The present time in seconds.
        quiet_s: Time without a new one after which the list has run dry.
        silent_s: Time without a new one after which it is given up.
        window: Requests on the way at once.

    Attributes:
        found: Those that have come, by name.
        count: Number of parameters by the component's messages.
    """

    def __init__(
        self, messages: ParameterMessages, *, now: float, quiet_s: float = 1.0, silent_s: float = 10.0, window: int = 10
    ) -> None:
        self.found: dict[str, Parameter] = {}
        self.count: int | None = None
        self.silent = self.cancelled = False
        self._messages, self._quiet_s, self._silent_s, self._window = messages, quiet_s, silent_s, window
        self._indices: set[int] = set()
        self._asking: _Asking[int] | None = None
        self._new_at = now
        self._listed_at: float | None = None

    @property
    def finished(self) -> bool:
        """Whether it is over: all are here, a long silence, or it was cancelled."""
        return self.silent or self.cancelled or (self.count is not None and len(self._indices) >= self.count)

    @property
    def missing(self) -> list[int]:
        """The missing indices."""
        return [index for index in range(self.count or 0) if index not in self._indices]

    def counts(self) -> tuple[int, int | None]:
        """Number of received parameters, and of all."""
        return len(self._indices), self.count

    def cancel(self, now: float) -> None:
        """Stop; the component need not know."""
        del now
        self.cancelled = True

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        heard = self._messages.heard(received)
        if heard is None or heard.parameter is None or heard.count == 0:
            return
        if self.count is not None and heard.count < self.count:
            self._indices = {index for index in self._indices if index < heard.count}
            self.found = {name: one for name, one in self.found.items() if (one.index or 0) < heard.count}
        self.count = heard.count
        index = heard.parameter.index
        if index is None or index >= heard.count:
            return
        self.found[heard.name] = heard.parameter
        if index not in self._indices:
            self._indices.add(index)
            self._new_at = now
        if self._asking is not None:
            self._asking.answered(index)

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        if not self.finished and now >= self._new_at + self._silent_s:
            self.silent = True
        if self.finished:
            return []
        if not self._indices:
            if self._listed_at is not None and now < self._listed_at + self._quiet_s:
                return []
            self._listed_at = now
            return [self._messages.list_request()]
        if self._asking is None or not self._asking.left:
            if now < self._new_at + self._quiet_s:
                return []
            self._asking = _Asking(self.missing, window=self._window, again_s=self._quiet_s)
        return [self._messages.read_request("", index) for index in self._asking.due(now)]

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it is over."""
        if self.finished:
            return None
        give_up_at = self._new_at + self._silent_s
        if not self._indices:
            return min(give_up_at, (self._listed_at or self._new_at) + self._quiet_s)
        if self._asking is None or not self._asking.left:
            return min(give_up_at, self._new_at + self._quiet_s)
        again_at = self._asking.next_timer()
        return give_up_at if again_at is None else min(give_up_at, again_at)


class _ParameterRequests:
    """Requests for parameters by name, until each is answered or the time is up.

    Attributes:
        refused: Those that the component refuses, each with its reason.
    """

    def __init__(
        self, messages: ParameterMessages, names: Iterable[str], *, until_s: float, again_s: float, window: int
    ) -> None:
        self.refused: dict[str, str] = {}
        self.cancelled = False
        self._messages, self._until = messages, until_s
        self._asking = _Asking(names, window=window, again_s=again_s)
        self._over = False

    @property
    def finished(self) -> bool:
        """Whether every name is answered, or the time is up."""
        return self._over or self.cancelled or not self._asking.left

    @property
    def missing(self) -> list[str]:
        """Names without an answer."""
        return list(self._asking.left)

    def cancel(self, now: float) -> None:
        """Stop; what was sent may be set all the same."""
        del now
        self.cancelled = True

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it is over."""
        if self.finished:
            return None
        again_at = self._asking.next_timer()
        return self._until if again_at is None else min(self._until, again_at)


class ParameterReads(_ParameterRequests):
    """Some parameters by name. A component may be silent about what it does not have, so this ends after ``timeout_s`` at most.

    Attributes:
        found: Those that have come, by name.
        refused: Those that the component does not give, each with its reason.
    """

    def __init__(
        self,
        messages: ParameterMessages,
        names: Collection[str],
        *,
        now: float,
        timeout_s: float = 3.0,
        again_s: float = 0.5,
        window: int = 20,
    ) -> None:
        super().__init__(messages, names, until_s=now + timeout_s, again_s=again_s, window=window)
        self.found: dict[str, Parameter] = {}

    def counts(self) -> tuple[int, int | None]:
        """Number of answered requests, and of all."""
        answered = len(self.found) + len(self.refused)
        return answered, answered + len(self._asking.left)

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        del now
        heard = self._messages.heard(received)
        if heard is None or heard.in_progress or not self._asking.answered(heard.name):
            return
        if heard.parameter is None:
            self.refused[heard.name] = heard.refused
        else:
            self.found[heard.name] = heard.parameter

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        self._over = self._over or now >= self._until
        return [] if self.finished else [self._messages.read_request(name) for name in self._asking.due(now)]


class ParameterWrites(_ParameterRequests):
    """Some parameters set, each until the component reports the new value, or another one three times.

    Attributes:
        confirmed: Those that the component reports with their new values.
        refused: Those that it refuses, or reports with another value, each with its reason.
    """

    def __init__(
        self,
        messages: ParameterMessages,  # the component's messages
        wanted: Sequence[Parameter],  # each with its value and type; a MisuseError if one does not fit
        *,
        now: float,  # the present time in seconds
        timeout_s: float = 10.0,  # longest duration for all of them
        again_s: float = 0.5,  # a silence after which one is sent again
        window: int = 5,  # requests on the way at once
    ) -> None:
        self._wanted: Mapping[str, Parameter] = {one.name: one for one in wanted}
        super().__init__(messages, self._wanted, until_s=now + timeout_s, again_s=again_s, window=window)
        self.confirmed: dict[str, Parameter] = {}
        self._requests = {
            one.name: messages.set_request(one.name, one.value, one.param_type) for one in self._wanted.values()
        }
        self._differing: Counter[str] = Counter()

    def counts(self) -> tuple[int, int | None]:
        """Number of settled parameters, and of all."""
        return len(self._wanted) - len(self._asking.left), len(self._wanted)

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        heard = self._messages.heard(received)
        if heard is None or heard.name not in self._asking.left:
            return
        if heard.in_progress:
            self._asking.wait_longer(heard.name, now)
            return
        wanted = self._wanted[heard.name]
        if heard.parameter is None:
            self.refused[heard.name] = heard.refused
        elif same_value(heard.parameter.value, wanted.value, wanted.param_type):
            self.confirmed[heard.name] = heard.parameter
        else:
            self._differing[heard.name] += 1
            if self._differing[heard.name] < VALUES.most_refusals:
                return
            self.refused[heard.name] = f"stays {heard.parameter.value!r}"
        self._asking.answered(heard.name)

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        self._over = self._over or now >= self._until
        return [] if self.finished else [self._requests[name] for name in self._asking.due(now)]
