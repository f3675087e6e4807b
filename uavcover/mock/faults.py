"""Faults by name: what goes wrong on the vehicle's side, and when; see ``parse_fault`` for how they are written."""

import math
import re
from dataclasses import dataclass
from enum import Enum

from uavcover.errors import InputError
from uavcover.vehicle.modes import Mode


class FaultKind(Enum):
    """What goes wrong; the value is the name that it is asked for by."""

    HEARTBEAT_LOSS = "heartbeat-loss"
    GPS_LOSS = "gps-loss"
    BATTERY_FAILSAFE = "battery-failsafe"
    PILOT_MODE = "pilot-mode"
    REBOOT = "reboot"
    LINK_OUTAGE = "link-outage"
    STUCK = "stuck"
    ARMING_REFUSED = "arming-refused"
    STRONG_WIND = "strong-wind"
    MISSION_CHANGED = "mission-changed"
    MISSION_LOWERED = "mission-lowered"
    FORCE_DISARM = "force-disarm"


class Since(Enum):
    """What the moment of a fault is counted from."""

    BOOT = "seconds after it was switched on"
    TAKE_OFF = "seconds after it first left the ground"
    ITEM = "the mission item (its number on the wire) that it flies to"


@dataclass(frozen=True, slots=True)
class Moment:
    """When a fault begins.

    Attributes:
        since: what is counted from.
        value: vehicle seconds, or the number of an item.
    """

    since: Since
    value: float


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes:
        kind: what goes wrong.
        moment: when.
        number: for how long or how much, see ``ARGUMENTS``; infinite for good.
        mode: what the pilot or the failsafe changes to; None where a fault has no mode.
    """

    kind: FaultKind
    moment: Moment
    number: float = math.inf
    mode: Mode | None = None

    def __str__(self) -> str:
        """The fault as ``parse_fault`` reads it."""
        argument = f":{self.mode.value}" if self.mode else f":{self.number:g}" if math.isfinite(self.number) else ""
        return f"{self.kind.value}{argument}@{_moment_text(self.moment)}"


@dataclass(frozen=True, slots=True)
class Argument:
    """What stands after the colon.

    Attributes:
        meaning: for people.
        default: the number when none is given; infinite is for good.
        modes: the modes that may be named instead of a number, the first is the default; none takes a number.
    """

    meaning: str
    default: float = math.inf
    modes: tuple[Mode, ...] = ()


_SECONDS = "seconds of vehicle time, without it for good"
_LINK_SECONDS = "seconds on the link's clock, without it for good"

ARGUMENTS: dict[FaultKind, Argument] = {
    FaultKind.HEARTBEAT_LOSS: Argument(_LINK_SECONDS),
    FaultKind.GPS_LOSS: Argument(_SECONDS),
    FaultKind.BATTERY_FAILSAFE: Argument("what it does: return or land", modes=(Mode.RETURN, Mode.LAND)),
    FaultKind.PILOT_MODE: Argument(
        "the mode: hold, land, return, guided or manual",
        modes=(Mode.HOLD, Mode.LAND, Mode.RETURN, Mode.GUIDED, Mode.MANUAL),
    ),
    FaultKind.REBOOT: Argument("seconds of vehicle time without power, 3 when not given", default=3.0),
    FaultKind.LINK_OUTAGE: Argument("seconds on the link's clock, 10 when not given", default=10.0),
    FaultKind.STUCK: Argument(_SECONDS),
    FaultKind.ARMING_REFUSED: Argument(_SECONDS),
    FaultKind.MISSION_LOWERED: Argument("metres, 25 when not given", default=25.0),
    FaultKind.STRONG_WIND: Argument("metres per second, 25 when not given", default=25.0),
}
"""What each fault takes after its colon; one that is not here takes nothing."""

_DEFAULT_MOMENT = Moment(Since.TAKE_OFF, 20.0)
_WRITTEN = re.compile(r"(?P<name>[a-z-]+)(?::(?P<argument>[^@]+))?(?:@(?P<moment>.+))?")
_MOMENT = re.compile(r"(?P<boot>boot\+)?(?P<seconds>\d+(?:\.\d+)?)s|item(?P<item>\d+)")


def parse_fault(text: str) -> Fault:
    """A fault from ``NAME[:ARGUMENT][@MOMENT]``.

    A moment is ``40s`` (vehicle seconds after the take-off), ``boot+40s`` (after it was switched on) or ``item5`` (when it
    flies to that mission item). Without one it is 20 s after the take-off, and for ``arming-refused`` the start.

    >>> str(parse_fault("gps-loss:30@40s"))
    'gps-loss:30@40s'
    >>> str(parse_fault("pilot-mode:land@item5"))
    'pilot-mode:land@item5'

    Raises:
        InputError: a name, an argument or a moment that does not exist; it names what does.
    """
    written = _WRITTEN.fullmatch(text)
    names = [kind.value for kind in FaultKind]
    if written is None or written["name"] not in names:
        raise InputError(f"fault {text!r}: there is none of that name; take one of {', '.join(names)}")
    kind = FaultKind(written["name"])
    moment = _parse_moment(text, written["moment"]) if written["moment"] else _default_moment(kind)
    argument = ARGUMENTS.get(kind)
    if argument is None:
        if written["argument"] is not None:
            raise InputError(f"fault {text!r}: {kind.value} takes nothing after a colon")
        return Fault(kind, moment)
    if argument.modes:
        return Fault(kind, moment, mode=_parse_mode(text, written["argument"], argument))
    return Fault(kind, moment, _parse_number(text, written["argument"], argument))


def _default_moment(kind: FaultKind) -> Moment:
    return Moment(Since.BOOT, 0.0) if kind is FaultKind.ARMING_REFUSED else _DEFAULT_MOMENT


def _parse_moment(text: str, moment: str) -> Moment:
    written = _MOMENT.fullmatch(moment)
    if written is None:
        raise InputError(f"fault {text!r}: {moment!r} is no moment; write 40s, boot+40s or item5")
    if written["item"] is not None:
        return Moment(Since.ITEM, float(written["item"]))
    return Moment(Since.BOOT if written["boot"] else Since.TAKE_OFF, float(written["seconds"]))


def _parse_mode(text: str, written: str | None, argument: Argument) -> Mode:
    if written is None:
        return argument.modes[0]
    for mode in argument.modes:
        if mode.value == written:
            return mode
    raise InputError(f"fault {text!r}: {written!r} is not {argument.meaning}")


def _parse_number(text: str, written: str | None, argument: Argument) -> float:
    if written is None:
        return argument.default
    try:
        number = float(written)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(f"fault {text!r}: {written!r} is no number above 0 ({argument.meaning})")
    return number


def _moment_text(moment: Moment) -> str:
    if moment.since is Since.ITEM:
        return f"item{moment.value:g}"
    return f"{'boot+' if moment.since is Since.BOOT else ''}{moment.value:g}s"
