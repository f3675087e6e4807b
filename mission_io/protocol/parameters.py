"""Parameters of a vehicle: how their values travel, and reading and setting them, sans-IO.

PARAM_VALUE has one 32-bit float for every type. Autopilots put integers into it in two ways: PX4 by their bits (bytewise),
ArduPilot by their value (C cast), which is exact up to 2**24. AUTOPILOT_VERSION says which. Extended parameters (PARAM_EXT_*)
have 128 bytes, of which a number takes as many as its type has, least significant first.
"""

import math
import struct
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from mission_io.errors import MisuseError
from mission_io.model.enums import ParamType
from mission_io.model.items import same_number
from mission_io.protocol.timing import VALUES
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, float32

Value: TypeAlias = int | float | bytes
"""A whole number, a number, or the bytes of an extended parameter of type CUSTOM."""

_LETTERS: Final = dict(zip(ParamType, "BbHhIiQqfd", strict=False))
_EXT_BYTES: Final = 128
_WORD_BYTES: Final = 4


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as a vehicle has it."""

    name: str  # at most 16 letters
    value: Value  # in its own unit: int for whole types, float for REAL32 and REAL64, bytes for CUSTOM
    param_type: int  # A ParamType, or the number of a type that does not exist
    index: int | None = None  # its place among all; None where the vehicle does not say


def is_whole(param_type: int) -> bool:
    """Whether a type holds whole numbers."""
    return ParamType.UINT8 <= param_type <= ParamType.INT64


def value_of_float(wire: float, param_type: int, *, bytewise: bool) -> int | float:
    """The value that a PARAM_VALUE carries; NaN for an integer that was cast from none.

    A type that does not exist, or that does not fit 32 bits, is taken as a 32-bit float.
    """
    letter = _LETTERS.get(_known(param_type), "f")
    if not is_whole(param_type) or struct.calcsize(letter) > _WORD_BYTES:
        return wire
    if bytewise:
        (value,) = struct.unpack_from(f"<{letter}", struct.pack("<f", wire))
        return int(value)
    return round(wire) if math.isfinite(wire) else wire


def float_of_value(value: float, param_type: int, *, bytewise: bool, name: str) -> float:
    """The float that PARAM_SET carries for a value; the inverse of ``value_of_float``.

    Raises:
        MisuseError: the value does not fit the type, or would arrive as another number.
    """
    if not is_whole(param_type):
        return float32(value)
    whole = _whole(value, param_type, name)
    letter = _LETTERS[ParamType(param_type)]
    if struct.calcsize(letter) > _WORD_BYTES:
        raise MisuseError(f"{name} has 64 bits, but PARAM_SET supports only 32")
    if not bytewise:
        if float32(float(whole)) != whole:
            raise MisuseError(f"{name} = {whole} does not fit in a 32-bit float; use a number below 2**24")
        return float(whole)
    packed = struct.pack(f"<{letter}", whole)
    fill = b"\xff" if whole < 0 else b"\0"
    (wire,) = struct.unpack("<f", packed + fill * (_WORD_BYTES - len(packed)))
    if struct.pack("<f", wire)[: len(packed)] != packed:
        raise MisuseError(f"{name} = {whole} cannot be sent, because its bits form a signalling NaN")
    return float(wire)


def value_of_bytes(raw: bytes, param_type: int) -> Value:
    """The value that a PARAM_EXT_VALUE carries; the bytes, without the zeros at their end, where the type is no number."""
    letter = _LETTERS.get(_known(param_type))
    if letter is None:
        return raw.rstrip(b"\0")
    (value,) = struct.unpack_from(f"<{letter}", raw.ljust(8, b"\0"))
    return float(value) if letter in "fd" else int(value)


def bytes_of_value(value: Value, param_type: int, *, name: str) -> bytes:
    """The 128 bytes that PARAM_EXT_SET carries for a value. Raises MisuseError: the value does not fit the type."""
    letter = _LETTERS.get(_known(param_type))
    if letter is None or isinstance(value, bytes):
        if letter is not None or not isinstance(value, bytes):
            raise MisuseError(f"{name}: only parameters of type CUSTOM accept bytes")
        if len(value) > _EXT_BYTES:
            raise MisuseError(f"{name} has {len(value)} bytes, but the limit is {_EXT_BYTES}")
        return value.ljust(_EXT_BYTES, b"\0")
    if letter == "f":
        value = float32(value)
    elif letter != "d":
        value = _whole(value, param_type, name)
    return struct.pack(f"<{letter}", value).ljust(_EXT_BYTES, b"\0")


def same_value(one: Value, other: Value, param_type: int) -> bool:
    """Whether two values are the same to a vehicle that stores ``param_type``."""
    if isinstance(one, bytes) or isinstance(other, bytes):
        return one == other
    if not is_whole(param_type) and param_type != ParamType.REAL64:
        one, other = float32(one), float32(other)
    return same_number(one, other)


def _known(param_type: int) -> ParamType:
    return ParamType(param_type) if param_type in ParamType._value2member_map_ else ParamType.CUSTOM


def _whole(value: float, param_type: int, name: str) -> int:
    """A value as a whole number of its type."""
    if not math.isfinite(value) or value != int(value):
        raise MisuseError(f"{name} = {value} is not a whole number, but {name} is {ParamType(param_type).name}")
    bits = 8 * struct.calcsize(_LETTERS[ParamType(param_type)])
    signed = param_type % 2 == 0  # the signed types have even numbers
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    if not low <= value <= high:
        raise MisuseError(f"{name} = {value:g} does not fit in {ParamType(param_type).name} ({low} to {high})")
    return int(value)


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


@dataclass(frozen=True, slots=True)
class ParameterMessages:
    """The messages about parameters, to and from one component."""

    to: Address  # the component
    bytewise: bool = False  # whether it sends the bits of an integer as if they were a float, or casts it
    extended: bool = False  # whether it has extended parameters

    def list_request(self) -> m.Message:
        """Asks for all."""
        kind = m.ParamExtRequestList if self.extended else m.ParamRequestList
        return kind(*self.to)

    def read_request(self, name: str, index: int = -1) -> m.Message:
        """Asks for one, by name or by index."""
        kind = m.ParamExtRequestRead if self.extended else m.ParamRequestRead
        return kind(*self.to, name, index)

    def set_request(self, wanted: Parameter) -> m.Message:
        """Asks to set one. Raises MisuseError: the value does not fit the type."""
        name, value, param_type = wanted.name, wanted.value, wanted.param_type
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


_Key = int | str
"""A parameter's index or name."""


class _Requests:
    """Outstanding requests: each is repeated after a silence, at most ``window`` at once, so that none floods the link."""

    def __init__(self, requests: Mapping[_Key, m.Message], *, window: int, again_s: float) -> None:
        self.left = dict(requests)
        self._window, self._again_s = window, again_s
        self._requested_at: dict[_Key, float] = {}

    def due(self, now: float) -> list[m.Message]:
        """Requests due now."""
        found: list[_Key] = []
        waiting = 0
        for key in self.left:
            requested_at = self._requested_at.get(key)
            if requested_at is not None and now < requested_at + self._again_s:
                waiting += 1
            elif waiting + len(found) < self._window:
                found.append(key)
            if waiting + len(found) >= self._window:
                break
        self._requested_at.update(dict.fromkeys(found, now))
        return [self.left[key] for key in found]

    def next_timer(self) -> float | None:
        """When the next is due; None while nothing is asked."""
        return min(self._requested_at.values()) + self._again_s if self._requested_at else None

    def answered(self, key: _Key) -> bool:
        """Whether this was requested; removes the request."""
        self._requested_at.pop(key, None)
        return self.left.pop(key, None) is not None

    def wait_longer(self, key: _Key, now: float) -> None:
        """Ask for this again only after another silence from now on."""
        if key in self._requested_at:
            self._requested_at[key] = now


_QUIET_S = 1.0
"""Time without a new parameter after which a list has run dry."""


class ParameterDownload:
    """All parameters of a component.

    The list is requested, repeatedly until the first one comes. When it runs dry, the missing ones are requested by
    their index. It is given up after ``silent_s`` seconds without a new one.

    Attributes:
        found: Those that have come, by name.
        count: Number of parameters by the component's messages.
    """

    def __init__(self, messages: ParameterMessages, *, now: float, silent_s: float) -> None:
        self.found: dict[str, Parameter] = {}
        self.count: int | None = None
        self.silent = self.cancelled = False
        self._messages, self._silent_s = messages, silent_s
        self._indices: set[int] = set()
        self._requests: _Requests | None = None
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
        if self._requests is not None:
            self._requests.answered(index)

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        if not self.finished and now >= self._new_at + self._silent_s:
            self.silent = True
        if self.finished:
            return []
        if not self._indices:
            if self._listed_at is not None and now < self._listed_at + _QUIET_S:
                return []
            self._listed_at = now
            return [self._messages.list_request()]
        if self._requests is None or not self._requests.left:
            if now < self._new_at + _QUIET_S:
                return []
            requests: dict[_Key, m.Message] = {index: self._messages.read_request("", index) for index in self.missing}
            self._requests = _Requests(requests, window=10, again_s=_QUIET_S)
        return self._requests.due(now)

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None if it needs none."""
        if self.finished:
            return None
        due_at: float | None = self._new_at + _QUIET_S
        if not self._indices:
            due_at = (self._listed_at or self._new_at) + _QUIET_S
        elif self._requests is not None and self._requests.left:
            due_at = self._requests.next_timer()
        give_up_at = self._new_at + self._silent_s
        return give_up_at if due_at is None else min(give_up_at, due_at)


class _ParameterRequests:
    """Requests for parameters by name, until each is answered or the time is up.

    Attributes:
        refused: Those that the component refuses, each with its reason.
    """

    def __init__(
        self, messages: ParameterMessages, requests: Mapping[_Key, m.Message], *, until_s: float, window: int
    ) -> None:
        self.refused: dict[str, str] = {}
        self.cancelled = False
        self._messages, self._until, self._count = messages, until_s, len(requests)
        self._requests = _Requests(requests, window=window, again_s=0.5)
        self._over = False

    @property
    def finished(self) -> bool:
        """Whether every name is answered, or the time is up."""
        return self._over or self.cancelled or not self._requests.left

    @property
    def missing(self) -> list[str]:
        """Names without an answer."""
        return [str(name) for name in self._requests.left]

    def cancel(self, now: float) -> None:
        """Stop; what was sent may be set anyway."""
        del now
        self.cancelled = True

    def counts(self) -> tuple[int, int | None]:
        """Number of settled parameters, and of all."""
        return self._count - len(self._requests.left), self._count

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        self._over = self._over or now >= self._until
        return [] if self.finished else self._requests.due(now)

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None if it needs none."""
        if self.finished:
            return None
        again_at = self._requests.next_timer()
        return self._until if again_at is None else min(self._until, again_at)


class ParameterReads(_ParameterRequests):
    """Some parameters by name. A component may be silent about what it does not have, so this ends after ``timeout_s`` at most.

    Attributes:
        found: Those that have come, by name.
    """

    def __init__(self, messages: ParameterMessages, names: Collection[str], *, now: float, timeout_s: float) -> None:
        requests: dict[_Key, m.Message] = {name: messages.read_request(name) for name in names}
        super().__init__(messages, requests, until_s=now + timeout_s, window=20)
        self.found: dict[str, Parameter] = {}

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        del now
        heard = self._messages.heard(received)
        if heard is None or heard.in_progress or not self._requests.answered(heard.name):
            return
        if heard.parameter is None:
            self.refused[heard.name] = heard.refused
        else:
            self.found[heard.name] = heard.parameter


class ParameterWrites(_ParameterRequests):
    """Some parameters set, each until the component reports the new value, or another one three times.

    Attributes:
        confirmed: Those that the component reports with their new values.
        refused: Those that it refuses, or reports with another value, each with its reason.

    Raises:
        MisuseError: a value does not fit its type.
    """

    def __init__(
        self, messages: ParameterMessages, wanted: Sequence[Parameter], *, now: float, timeout_s: float
    ) -> None:
        self._wanted: Mapping[str, Parameter] = {one.name: one for one in wanted}
        requests: dict[_Key, m.Message] = {one.name: messages.set_request(one) for one in wanted}
        super().__init__(messages, requests, until_s=now + timeout_s, window=5)
        self.confirmed: dict[str, Parameter] = {}
        self._differing: Counter[str] = Counter()

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        heard = self._messages.heard(received)
        if heard is None or heard.name not in self._requests.left:
            return
        if heard.in_progress:
            self._requests.wait_longer(heard.name, now)
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
        self._requests.answered(heard.name)
