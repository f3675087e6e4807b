"""Faults by name and time; ``parse_fault`` documents the notation."""

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

from mission_io.autopilots.autopilot import Mode
from uavcover.errors import InputError
from uavcover.mock.behaviour import BODY


class FaultKind(Enum):
    """Kind of fault; the value is its name on the command line."""

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
    MOTOR_FAILURE = "motor-failure"
    GPS_GLITCH = "gps-glitch"
    SPEED_CHANGED = "speed-changed"
    ITEM_SET_BACK = "item-set-back"
    CAMERA_STOPS = "camera-stops"
    CAMERA_SKIPS = "camera-skips"
    CAMERA_SILENT = "camera-silent"


class Since(Enum):
    """Start of a fault's time."""

    BOOT = "seconds after the vehicle was switched on"
    TAKE_OFF = "seconds after the vehicle first left the ground"
    ITEM = "the current mission item (its number on the wire)"


@dataclass(frozen=True, slots=True)
class FaultTrigger:
    """When a fault begins."""

    since: Since  # the reference
    value: float  # vehicle seconds after it, or the number of an item

    def has_come(self, powered_s: float, took_off_at_s: float | None, current_seq: int) -> bool:
        """Whether its time has come.

        Args:
            powered_s: vehicle time since the vehicle was first switched on.
            took_off_at_s: that time at its first take-off; None before.
            current_seq: wire number of the mission item that it flies to.
        """
        if self.since is Since.BOOT:
            return powered_s >= self.value
        if self.since is Since.TAKE_OFF:
            return took_off_at_s is not None and powered_s >= took_off_at_s + self.value
        return took_off_at_s is not None and current_seq >= self.value


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault."""

    kind: FaultKind  # what goes wrong
    trigger: FaultTrigger  # when it begins
    number: float = math.inf  # duration or amount, see ``ARGUMENTS``; infinite is permanent
    mode: Mode | None = None  # what the pilot or the failsafe changes to; None where a fault has no mode

    def __str__(self) -> str:
        """The fault as ``parse_fault`` reads it."""
        argument = f":{self.mode.value}" if self.mode else f":{self.number:g}" if math.isfinite(self.number) else ""
        return f"{self.kind.value}{argument}@{_trigger_text(self.trigger)}"


@dataclass(frozen=True, slots=True)
class Argument:
    """The argument after the colon."""

    meaning: str  # shown to the user
    default: float = math.inf  # the number when none is given; infinite is permanent
    # the modes that may be named instead of a number, the default first; empty for a number
    modes: tuple[Mode, ...] = ()


_ON_THE_LINKS_CLOCK = (FaultKind.HEARTBEAT_LOSS, FaultKind.LINK_OUTAGE)
_SECONDS = "seconds of vehicle time; permanent if omitted"
_LINK_SECONDS = "seconds on the link's clock; permanent if omitted"

ARGUMENTS: dict[FaultKind, Argument] = {
    FaultKind.HEARTBEAT_LOSS: Argument(_LINK_SECONDS),
    FaultKind.GPS_LOSS: Argument(_SECONDS),
    FaultKind.BATTERY_FAILSAFE: Argument("the action: return or land", modes=(Mode.RETURN, Mode.LAND)),
    FaultKind.PILOT_MODE: Argument(
        "the mode: hold, land, return, guided or manual",
        modes=(Mode.HOLD, Mode.LAND, Mode.RETURN, Mode.GUIDED, Mode.MANUAL),
    ),
    FaultKind.REBOOT: Argument("seconds of vehicle time without power; default: 3", default=3.0),
    FaultKind.LINK_OUTAGE: Argument("seconds on the link's clock; default: 10", default=10.0),
    FaultKind.STUCK: Argument(_SECONDS),
    FaultKind.ARMING_REFUSED: Argument(_SECONDS),
    FaultKind.MISSION_LOWERED: Argument("metres; default: 25", default=25.0),
    FaultKind.GPS_GLITCH: Argument("metres, for 20 s; default: 60", default=60.0),
    FaultKind.SPEED_CHANGED: Argument("metres per second; default: 3", default=3.0),
    FaultKind.STRONG_WIND: Argument("metres per second; default: 25", default=25.0),
    FaultKind.CAMERA_STOPS: Argument("number of photos after which the camera fails; default: 4", default=4.0),
    FaultKind.CAMERA_SKIPS: Argument("number of triggers for one photo; default: 10", default=10.0),
}
"""The argument of each fault; a fault that is not listed takes none."""

_DEFAULT_TRIGGER = FaultTrigger(Since.TAKE_OFF, 20.0)
_FROM_THE_START = (
    FaultKind.ARMING_REFUSED,
    FaultKind.CAMERA_STOPS,
    FaultKind.CAMERA_SKIPS,
    FaultKind.CAMERA_SILENT,
)
_WRITTEN = re.compile(r"(?P<name>[a-z-]+)(?::(?P<argument>[^@]+))?(?:@(?P<moment>.+))?")
_MOMENT = re.compile(r"(?P<boot>boot\+)?(?P<seconds>\d+(?:\.\d+)?)s|item(?P<item>\d+)")


def parse_fault(text: str) -> Fault:
    """A fault from ``NAME[:ARGUMENT][@MOMENT]``.

    A moment is ``40s`` (vehicle seconds after the take-off), ``boot+40s`` (after it was switched on) or ``item5`` (when it
    flies to that mission item). Without one it is 20 s after the take-off, and for ``arming-refused`` and those of
    the camera the start.

    >>> str(parse_fault("gps-loss:30@40s"))
    'gps-loss:30@40s'
    >>> str(parse_fault("pilot-mode:land@item5"))
    'pilot-mode:land@item5'

    Raises:
        InputError: an unknown name, argument or moment; the error lists the valid ones.
    """
    written = _WRITTEN.fullmatch(text)
    names = [kind.value for kind in FaultKind]
    if written is None or written["name"] not in names:
        raise InputError(f"fault {text!r}: unknown name; use one of {', '.join(names)}")
    kind = FaultKind(written["name"])
    trigger = FaultTrigger(Since.BOOT, 0.0) if kind in _FROM_THE_START else _DEFAULT_TRIGGER
    if written["moment"]:
        trigger = _parse_trigger(text, written["moment"])
    argument = ARGUMENTS.get(kind)
    if argument is None:
        if written["argument"] is not None:
            raise InputError(f"fault {text!r}: {kind.value} does not accept a value after the colon")
        return Fault(kind, trigger)
    if argument.modes:
        return Fault(kind, trigger, mode=_parse_mode(text, written["argument"], argument))
    return Fault(kind, trigger, _parse_number(text, written["argument"], argument))


def _parse_trigger(text: str, moment: str) -> FaultTrigger:
    written = _MOMENT.fullmatch(moment)
    if written is None:
        raise InputError(f"fault {text!r}: {moment!r} is not a time or an item, such as 40s, boot+40s or item5")
    if written["item"] is not None:
        return FaultTrigger(Since.ITEM, float(written["item"]))
    return FaultTrigger(Since.BOOT if written["boot"] else Since.TAKE_OFF, float(written["seconds"]))


def _parse_mode(text: str, written: str | None, argument: Argument) -> Mode:
    if written is None:
        return argument.modes[0]
    for mode in argument.modes:
        if mode.value == written:
            return mode
    raise InputError(f"fault {text!r}: expected {argument.meaning}, not {written!r}")


def _parse_number(text: str, written: str | None, argument: Argument) -> float:
    if written is None:
        return argument.default
    try:
        number = float(written)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(f"fault {text!r}: expected a number above 0 ({argument.meaning}), not {written!r}")
    return number


def _trigger_text(trigger: FaultTrigger) -> str:
    if trigger.since is Since.ITEM:
        return f"item{trigger.value:g}"
    return f"{'boot+' if trigger.since is Since.BOOT else ''}{trigger.value:g}s"


class FaultSchedule:
    """The future faults, and those in effect.

    Args:
        faults: what is to come.
        link_speed: vehicle seconds per second on the link's clock.

    Attributes:
        begun: every fault that has begun, in that order.
    """

    def __init__(self, faults: Iterable[Fault] = (), *, link_speed: float = 1.0) -> None:
        self.begun: list[Fault] = []
        self._link_speed = link_speed
        self._coming = list(faults)
        self._going_on: list[tuple[float, Fault]] = []

    def add(self, fault: Fault) -> None:
        """Add a fault; it begins at once when its moment has passed."""
        self._coming.append(fault)

    def is_going_on(self, kind: FaultKind) -> bool:
        """Whether a fault of this kind has begun and not ended."""
        return any(fault.kind is kind for _, fault in self._going_on)

    def take_due(self, powered_s: float, *, took_off_at_s: float | None, current_seq: int) -> Iterator[Fault]:
        """The faults that begin now, each in effect from when it is yielded.

        Args:
            powered_s: vehicle time since the vehicle was first switched on.
            took_off_at_s: that time at its first take-off; None before.
            current_seq: wire number of the mission item that it flies to.
        """
        if not self._coming:
            return
        for fault in [f for f in self._coming if f.trigger.has_come(powered_s, took_off_at_s, current_seq)]:
            self._coming.remove(fault)
            self.begun.append(fault)
            per_second = self._link_speed if fault.kind in _ON_THE_LINKS_CLOCK else 1.0
            lasts_s = BODY.glitch_s if fault.kind is FaultKind.GPS_GLITCH else fault.number * per_second
            self._going_on.append((powered_s + lasts_s, fault))
            yield fault

    def take_ended(self, powered_s: float) -> Iterator[Fault]:
        """The faults that end now, each no longer in effect when it is yielded."""
        for ends_s, fault in list(self._going_on):
            if powered_s >= ends_s:
                self._going_on.remove((ends_s, fault))
                yield fault
