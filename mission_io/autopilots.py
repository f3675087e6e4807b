"""What ArduPilot and PX4 do differently with missions, as data, and missions put into each one's terms.

Every fact was observed on a simulated vehicle of ArduCopter 4.7 or PX4 1.17, or read in their sources.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mission_io.enums import AutopilotId, MissionResult
from mission_io.errors import MisuseError
from mission_io.items import Command, Frame, GeoPoint, Mission, MissionItem, MissionType
from mission_io.wire import float32

WITHOUT_POSITION = frozenset(
    {
        Command.NAV_RETURN_TO_LAUNCH,
        Command.NAV_DELAY,
        Command.DO_CHANGE_SPEED,
        Command.DO_SET_ROI_NONE,
        Command.DO_MOUNT_CONTROL,
        Command.DO_SET_CAM_TRIGG_DIST,
    }
)
"""The commands mission_io knows to have no position, whatever frame they come with."""


@dataclass(frozen=True, slots=True)
class StorageRule:
    """One way in which an autopilot changes what it is given, by design.

    Attributes:
        field: The changed field: ``param1`` to ``param4`` or ``alt_m``.
        commands: The commands it concerns.
        store: From the number sent to the number that comes back.
        largest_change: A larger change is not by design, even when ``store`` predicts it.
        why: The reason, for people.
    """

    field: str
    commands: frozenset[int]
    store: Callable[[float], float]
    largest_change: float
    why: str


@dataclass(frozen=True, slots=True)
class Autopilot:
    """One autopilot's way with missions.

    Attributes:
        name: For people.
        mav_autopilot: Its MAV_AUTOPILOT number in heartbeats.
        home_in_item_0: Whether item 0 of a mission is home (overwritten by the vehicle's own) or the first item.
        frames: The frames it takes for positions.
        position_free_frames: The frames it takes for commands without a position.
        command_frame_returned: The frame that such a command comes back with.
        storage: What it changes in the numbers it stores.
        keeps_autocontinue: Whether that flag comes back as it was sent. If not, it comes back set, and not set from fences
            and rally points (seen with ArduCopter 4.7).
        nan_allowed: For each command, the parameters (1 to 4) that may be NaN; key 0 is every other command.
        refuses_bad_numbers: Whether an item with an impossible number is refused, or taken as it is.
        item_limit: More items than this are refused (None: it depends on the board).
        legacy_requests: Whether it asks for items with the deprecated MISSION_REQUEST.
        rerequest_s: It asks again after this silence.
        give_up_s: It ends an upload after this silence.
        says_give_up: Whether it tells (with OPERATION_CANCELLED) that it gave up.
        atomic: The lists that a failed upload leaves as they were.
        busy_result: What a second ground station's upload is answered.
        count_restarts: Whether a COUNT in the middle of an upload starts it over; if not, it is answered ERROR.
        wrong_sequence_result: What an item that was not asked for is answered; None for nothing.
        acks_repeated_last_item: Whether the last item, sent again after the end, is acknowledged again.
        idle_item_result: What an item is answered when no upload is going on; None for nothing.
        download_blocks_s: For how long a download that was not acknowledged keeps uploads out; 0 for not at all.
        boot_refusal_s: For how long after boot an upload is answered NO_SPACE.
    """

    name: str
    mav_autopilot: AutopilotId
    home_in_item_0: bool
    frames: frozenset[Frame]
    position_free_frames: frozenset[Frame]
    command_frame_returned: Frame
    storage: tuple[StorageRule, ...]
    keeps_autocontinue: bool
    nan_allowed: Mapping[int, frozenset[int]]
    refuses_bad_numbers: bool
    item_limit: int | None
    legacy_requests: bool
    rerequest_s: float
    give_up_s: float
    says_give_up: bool
    atomic: frozenset[MissionType]
    busy_result: MissionResult
    count_restarts: bool
    wrong_sequence_result: MissionResult | None
    acks_repeated_last_item: bool
    idle_item_result: MissionResult | None
    download_blocks_s: float
    boot_refusal_s: float

    def rule_for(self, item: MissionItem, field_name: str) -> StorageRule | None:
        """The storage rule that concerns a field of an item, if any."""
        return next((r for r in self.storage if r.field == field_name and item.command in r.commands), None)


def _dropped(_: float) -> float:
    return 0.0


def _whole_uint16(value: float) -> float:
    return float(math.trunc(value) & 0xFFFF) if math.isfinite(value) else 0.0


def _to_centimetres(value: float) -> float:
    """Truncated toward zero, as a C cast does, in the arithmetic of 32-bit floats."""
    return math.trunc(float32(float32(value) * 100.0)) / 100.0 if math.isfinite(value) else 0.0


def _to_metres(value: float) -> float:
    return float(math.trunc(value)) if math.isfinite(value) else 0.0


def _turn_direction(value: float) -> float:
    return -1.0 if value < 0.0 else 1.0


_PLACES = frozenset({Command.NAV_WAYPOINT, Command.NAV_TAKEOFF, Command.NAV_LAND, Command.DO_SET_ROI_LOCATION})
_WAYPOINT = frozenset({Command.NAV_WAYPOINT})
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_RALLY = frozenset({Command.NAV_RALLY_POINT})
NOT_STEPS = _FENCE | _RALLY
"""The commands of fences and rally points: they are never flown one after the other."""


def _drop(names: Sequence[str], commands: frozenset[int], why: str) -> tuple[StorageRule, ...]:
    return tuple(StorageRule(name, commands, _dropped, math.inf, why) for name in names)


ARDUPILOT = Autopilot(
    name="ArduPilot",
    mav_autopilot=AutopilotId.ARDUPILOT,
    home_in_item_0=True,
    frames=frozenset({Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN}),
    position_free_frames=frozenset(Frame),
    command_frame_returned=Frame.AMSL,
    storage=(
        StorageRule(
            "param1", _WAYPOINT, _whole_uint16, 0.9999999, "ArduPilot stores a waypoint's hold time in whole seconds"
        ),
        StorageRule(
            "param4",
            frozenset({Command.NAV_LAND}),
            _turn_direction,
            math.inf,
            "ArduPilot keeps only the sign of a landing's fourth parameter, as 1 or -1 (seen with ArduCopter 4.7)",
        ),
        *_drop(("param2", "param3", "param4"), _PLACES, "ArduPilot keeps only the first parameter of this command"),
        *_drop(("param2", "param4"), frozenset({Command.DO_SET_CAM_TRIGG_DIST}), "ArduPilot has no use for it"),
        StorageRule("alt_m", _PLACES, _to_centimetres, 0.01001, "ArduPilot truncates altitudes to centimetres"),
        *_drop(("param2", "param3", "param4", "alt_m"), _FENCE, "ArduPilot keeps only the place and size of a fence"),
        *_drop(("param1", "param2", "param3", "param4"), _RALLY, "ArduPilot keeps only the place of a rally point"),
        StorageRule("alt_m", _RALLY, _to_metres, 1.0, "ArduPilot truncates rally altitudes to metres"),
    ),
    keeps_autocontinue=False,
    nan_allowed={
        Command.NAV_WAYPOINT: frozenset({4}),
        Command.NAV_LAND: frozenset({4}),
        Command.NAV_TAKEOFF: frozenset({4}),
    },
    refuses_bad_numbers=True,
    item_limit=650,
    legacy_requests=True,
    rerequest_s=1.0,
    give_up_s=8.0,
    says_give_up=True,
    atomic=frozenset({MissionType.FENCE}),
    busy_result=MissionResult.DENIED,
    count_restarts=True,
    wrong_sequence_result=MissionResult.INVALID_SEQUENCE,
    acks_repeated_last_item=False,
    idle_item_result=MissionResult.ERROR,
    download_blocks_s=0.0,
    boot_refusal_s=2.0,
)
"""ArduPilot (ArduCopter)."""

PX4 = Autopilot(
    name="PX4",
    mav_autopilot=AutopilotId.PX4,
    home_in_item_0=False,
    frames=frozenset({Frame.AMSL, Frame.ABOVE_HOME}),
    position_free_frames=frozenset({Frame.COMMAND}),
    command_frame_returned=Frame.COMMAND,
    storage=_drop(("param3",), _WAYPOINT, "PX4 does not store a waypoint's pass radius"),
    keeps_autocontinue=True,
    nan_allowed={0: frozenset({1, 2, 3, 4})},
    refuses_bad_numbers=False,
    item_limit=None,
    legacy_requests=False,
    rerequest_s=0.25,
    give_up_s=5.0,
    says_give_up=False,
    atomic=frozenset(MissionType),
    busy_result=MissionResult.ERROR,
    count_restarts=False,
    wrong_sequence_result=None,
    acks_repeated_last_item=True,
    idle_item_result=None,
    download_blocks_s=5.3,
    boot_refusal_s=0.0,
)
"""PX4."""

AUTOPILOTS = (ARDUPILOT, PX4)


def autopilot_for(mav_autopilot: int) -> Autopilot:
    """The autopilot with a MAV_AUTOPILOT number.

    Raises:
        MisuseError: one that mission_io does not know.
    """
    for autopilot in AUTOPILOTS:
        if autopilot.mav_autopilot == mav_autopilot:
            return autopilot
    raise MisuseError(f"autopilot {mav_autopilot} is not known; mission_io knows ArduPilot (3) and PX4 (12)")


def wire_items(mission: Mission, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """A mission's items as they are sent to an autopilot: with home in front where item 0 is home.

    An autopilot that keeps home in item 0 puts its own home there, so a mission without a home is sent with a
    waypoint at latitude 0, longitude 0, only to keep the place. Jumps name items as the vehicle counts them.
    """
    if not autopilot.home_in_item_0:
        return tuple(jumps_moved(mission.items, by=-1))
    home = mission.home if mission.home is not None else GeoPoint(0.0, 0.0, 0.0)
    return (home_item(home), *mission.items)


def jumps_moved(items: Iterable[MissionItem], *, by: int) -> Iterator[MissionItem]:
    """The items with every DO_JUMP going to an item so many further on."""
    for item in items:
        if item.command == Command.DO_JUMP:
            p1, p2, p3, p4 = item.params
            yield replace(item, params=(p1 + by, p2, p3, p4))
        else:
            yield item


def home_item(home: GeoPoint) -> MissionItem:
    """Home as the row or item 0 that files and ArduPilot keep it in."""
    return MissionItem(
        Command.NAV_WAYPOINT, Frame.AMSL, lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_m=home.alt_amsl_m
    )


def mission_from_wire(items: Sequence[MissionItem], autopilot: Autopilot) -> Mission:
    """The mission that an autopilot's item list stands for; the inverse of ``wire_items``.

    Commands known to have no position get the frame COMMAND, whichever the autopilot returned them with.
    """
    home = None
    if autopilot.home_in_item_0 and items:
        first, *items = items
        home = GeoPoint(first.lat_deg, first.lon_deg, first.alt_m)
    elif not autopilot.home_in_item_0:
        items = tuple(jumps_moved(items, by=1))
    return Mission(home, tuple(_without_frame(item) for item in items))


def _without_frame(item: MissionItem) -> MissionItem:
    if item.command not in WITHOUT_POSITION or not item.has_position:
        return item
    return MissionItem(item.command, Frame.COMMAND, item.params, autocontinue=item.autocontinue)


def stored_item(item: MissionItem, autopilot: Autopilot) -> MissionItem:
    """The item as this autopilot gives it back: what travels on the wire, changed by its storage rules."""

    def kept(name: str, value: float) -> float:
        rule = autopilot.rule_for(item, name)
        return float32(rule.store(value) if rule is not None else value)

    p1, p2, p3, p4 = (kept(f"param{i}", value) for i, value in enumerate(item.params, start=1))
    free = not item.has_position or item.command in WITHOUT_POSITION
    return MissionItem(
        item.command,
        autopilot.command_frame_returned if free else item.frame,
        (p1, p2, p3, p4),
        item.lat_deg,
        item.lon_deg,
        kept("alt_m", item.alt_m),
        item.autocontinue if autopilot.keeps_autocontinue else item.command not in NOT_STEPS,
    )
