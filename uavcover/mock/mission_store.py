"""The mission, fence and rally points that the mock vehicle holds, and whether it is inside the fence."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.mission_lists import list_is_whole, refusal_of, stored_item
from mission_io.errors import FormatError
from mission_io.formats.wpl import dat_path, read_mission_dat, write_mission_dat
from mission_io.model.enums import AutopilotId, MissionResult
from mission_io.model.items import (
    EQUATOR_M_PER_DEG,
    Command,
    Fence,
    GeoPoint,
    MissionItem,
    MissionType,
    fence_from_items,
)
from mission_io.protocol.server import ListChanged, MissionServer, id_of_items
from mission_io.protocol.tables import ServerState
from mission_io.protocol.terrain import (
    ALL_PARTS,
    DEFAULT_SPACING_M,
    PART_COUNT,
    PART_SIDE,
    PARTS_EAST,
    Part,
    Position,
    TerrainBlock,
    block_with_corner,
    position_in_block,
    wrapped_deg,
)
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, message_from_item
from mission_io.wire.telemetry_messages import TerrainData, TerrainReport, TerrainRequest
from uavcover.mock.behaviour import LINK, Parameters
from uavcover.mock.body import MockBody
from uavcover.mock.dynamics import Vector
from uavcover.terrain.frames import LocalFrame

# Terrain heights as ArduPilot obtains them: a grid requested with TERRAIN_REQUEST and answered block by block.


class TerrainFeed:
    """Requests blocks of terrain heights, keeps the answers, and interpolates between them."""

    def __init__(self, spacing_m: int = DEFAULT_SPACING_M) -> None:
        self.spacing_m = spacing_m
        self._blocks: dict[TerrainBlock, dict[int, Part]] = {}
        self._requested_at_s = -math.inf
        self._next = 0

    def want(self, positions: Iterable[Position]) -> None:
        """Request the blocks of these positions from now on."""
        for lat_deg, lon_deg in positions:
            self._blocks.setdefault(position_in_block(lat_deg, lon_deg, self.spacing_m).block, {})

    def want_for(self, home: GeoPoint, items: Iterable[MissionItem]) -> None:
        """Request the blocks of home, of every waypoint, and of four positions around it."""
        self.want([(home.lat_deg, home.lon_deg)])
        step_deg = LINK.terrain_around_spacings * self.spacing_m / EQUATOR_M_PER_DEG
        for item in items:
            if item.command == Command.NAV_WAYPOINT and item.has_position:
                lat, lon = item.lat_deg, item.lon_deg
                step_lon_deg = step_deg / max(0.01, math.cos(math.radians(lat)))
                around = [(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
                self.want((lat + n * step_deg, wrapped_deg(lon + e * step_lon_deg)) for n, e in around)

    def request(self, now: float) -> TerrainRequest | None:
        """A request, at most each two seconds, while something is missing; block after block."""
        lacking = [block for block, parts in self._blocks.items() if len(parts) < PART_COUNT]
        if not lacking or now < self._requested_at_s + LINK.terrain_ask_every_s:
            return None
        self._requested_at_s, self._next = now, self._next + 1
        block = lacking[self._next % len(lacking)]
        there = sum(1 << part for part in self._blocks[block])
        lat_e7, lon_e7 = block.corner_e7
        return TerrainRequest(lat_e7 / 1e7, lon_e7 / 1e7, self.spacing_m, ALL_PARTS & ~there)

    def take(self, data: TerrainData) -> None:
        """Keep an answer; one that was not requested is ignored."""
        if data.spacing_m != self.spacing_m or not 0 <= data.part < PART_COUNT:
            return
        block = block_with_corner(data.lat_deg, data.lon_deg, data.spacing_m)
        if block is not None and block in self._blocks:
            self._blocks[block][data.part] = data.heights_amsl_m

    @property
    def pending(self) -> int:
        """Requested parts that have not arrived."""
        return sum(PART_COUNT - len(parts) for parts in self._blocks.values())

    def height_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """Height of the ground, bilinear between known heights; None where one is missing."""
        position = position_in_block(lat_deg, lon_deg, self.spacing_m)
        parts = self._blocks.get(position.block, {})
        row, column = math.floor(position.row), math.floor(position.column)
        north_fraction, east_fraction = position.row - row, position.column - column
        height = 0.0
        for at_row, row_weight in ((row, 1.0 - north_fraction), (row + 1, north_fraction)):
            for at_column, weight in ((column, 1.0 - east_fraction), (column + 1, east_fraction)):
                part = parts.get(at_row // PART_SIDE * PARTS_EAST + at_column // PART_SIDE)
                if part is None:
                    return None
                height += row_weight * weight * part[at_row % PART_SIDE * PART_SIDE + at_column % PART_SIDE]
        return height

    def known_or(self, otherwise: Callable[[float, float], float]) -> Callable[[float, float], float]:
        """The known ground, and ``otherwise`` if unknown."""

        def ground(lat_deg: float, lon_deg: float) -> float:
            height = self.height_amsl_m(lat_deg, lon_deg)
            return otherwise(lat_deg, lon_deg) if height is None else height

        return ground

    def report(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> TerrainReport:
        """The TERRAIN_REPORT at a position and an altitude."""
        loaded = sum(len(parts) for parts in self._blocks.values())
        ground_m = self.height_amsl_m(lat_deg, lon_deg)
        if ground_m is None:  # MAVLink cannot express "unknown" here: spacing 0 stands for it
            return TerrainReport(lat_deg, lon_deg, 0, 0.0, 0.0, self.pending, loaded)
        return TerrainReport(lat_deg, lon_deg, self.spacing_m, ground_m, alt_amsl_m - ground_m, self.pending, loaded)


class MissionStore:
    """Mission, fence and rally points, and the transfers that read and change them."""

    def __init__(
        self,
        autopilot: Autopilot,  # the autopilot whose rules apply
        *,
        local: Address,  # the vehicle's address
        seconds_per_s: float,  # seconds on the clock of the transfer timeouts, per second of vehicle time
        stale_read_back: float,  # fraction of the uploads after which the previous list is still returned for 0.1 s
        rng: np.random.Generator,  # decides which uploads
    ) -> None:
        self._autopilot, self._local, self._scale = autopilot, local, seconds_per_s
        self._stale_read_back, self._rng = stale_read_back, rng
        self._server = self._booted(0.0)
        self._held_back: list[tuple[float, MissionType, tuple[MissionItem, ...]]] = []
        self._before: dict[MissionType, tuple[MissionItem, ...]] = {}
        self._ids: dict[MissionType, tuple[tuple[MissionItem, ...], int]] = {}

    def _booted(self, vehicle_s: float) -> MissionServer:
        # Booting takes vehicle time, independent of the clock of transfer timeouts.
        refusal_s = self._autopilot.boot_refusal_s
        booted_at = (vehicle_s + refusal_s) * self._scale - refusal_s
        return MissionServer(self._autopilot, local=self._local, booted_at=booted_at)

    def items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """The list that the vehicle holds and flies, in wire order."""
        for _, held_back, items in self._held_back:
            if held_back is mission_type:
                return items
        return self._server.items(mission_type)

    def list_id(self, mission_type: MissionType) -> int:
        """PX4's id of a list, which changes with its content; 0 for an empty one and on ArduPilot."""
        items = self.items(mission_type)
        if not self._autopilot.has_list_ids or not items:
            return 0
        known = self._ids.get(mission_type)
        if known is None or known[0] != items:
            known = self._ids[mission_type] = (items, id_of_items(items))
        return known[1]

    def replace(self, mission_type: MissionType, items: Iterable[MissionItem]) -> None:
        """Replace a list from the vehicle's own side, without a transfer."""
        self._server.set_items(mission_type, items)

    def load(self, mission_type: MissionType, items: Iterable[MissionItem]) -> None:
        """Replace a list by one from a file: to the vehicle it is an upload."""
        self._server.set_items(mission_type, items, uploaded=True)

    def set_home(self, home: GeoPoint) -> None:
        """Set home, for an autopilot that keeps it in item 0."""
        self._server.home = home

    def reboot(self, vehicle_s: float) -> None:
        """Drop every transfer and keep the lists: they are in permanent memory."""
        kept = {mission_type: self.items(mission_type) for mission_type in MissionType}
        self._held_back.clear()
        self._server = self._booted(vehicle_s)
        for mission_type, items in kept.items():
            self._server.set_items(mission_type, items)

    def receive(self, received: m.Received, vehicle_s: float, *, flying: bool) -> list[m.Message]:
        """Handle a message and return the immediate answers."""
        message = received.message
        ardupilot = self._autopilot.mav_autopilot == AutopilotId.ARDUPILOT
        if flying and ardupilot and isinstance(message, m.MissionClearAll):
            to = received.sender
            return [m.MissionAck(*to, MissionResult.ERROR, message.mission_type)]
        if self._stale_read_back:
            self._before = {mission_type: self._server.items(mission_type) for mission_type in MissionType}
        self._server.receive(received, vehicle_s * self._scale)
        return []

    def messages_to_send(self, vehicle_s: float) -> list[m.Message]:
        """Messages that are due by now."""
        if self._held_back and self._server.state is not ServerState.SENDING:
            for due in [entry for entry in self._held_back if entry[0] <= vehicle_s]:
                self._held_back.remove(due)
                self._server.set_items(due[1], due[2])
        return self._server.messages_to_send(vehicle_s * self._scale)

    def events(self, vehicle_s: float) -> list[ListChanged]:
        """List changes since the last call."""
        events = self._server.events()
        for event in events:
            stale = event.reason == "uploaded" and self._rng.random() < self._stale_read_back
            if self._stale_read_back and stale:
                self._held_back.append((vehicle_s + LINK.stale_s, event.mission_type, event.items))
                self._server.set_items(event.mission_type, self._before[event.mission_type])
        return events


class ListFiles:
    """The files, as ``AP_Filesystem_Mission`` has them.

    A file that is no list changes nothing. An item that is refused ends a mission or rally points, whose old ones are gone by
    then; a fence is replaced as a whole or not at all. The writer gets no answer about it.
    """

    def __init__(self, missions: MissionStore, autopilot: Autopilot) -> None:
        self._missions, self._autopilot = missions, autopilot
        self._kinds = {dat_path(kind): kind for kind in MissionType}

    def read(self, path: str) -> bytes | None:
        """A list as a file; None for any other file."""
        kind = self._kinds.get(path)
        return None if kind is None else write_mission_dat(self._missions.items(kind), kind)

    def written(self, path: str, content: bytes) -> None:
        """Take a list that was written."""
        kind = self._kinds.get(path)
        if kind is None:
            return
        try:
            items = read_mission_dat(content, kind)
        except FormatError:
            return
        taken = []
        for seq, item in enumerate(items):
            message = message_from_item(item, seq, mission_type=kind, target_system=0, target_component=0)
            if refusal_of(message, self._autopilot) is not None:
                break
            taken.append(stored_item(item, self._autopilot))
        whole = len(taken) == len(items) and list_is_whole(tuple(taken), kind)
        if whole or kind not in self._autopilot.atomic:
            self._missions.load(kind, taken)


Ring = tuple[tuple[float, float], ...]

_HEIGHT, _CIRCLE, _AREAS, _FLOOR = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""


class FenceWatch:
    """Tells whether the vehicle breaches the fence that it holds, or the limits in its parameters.

    Args:
        missions: holds the fence.
        body: gives the vehicle's frame and believed position.
        parameters: the fence parameters of the autopilot.
        ardupilot: whether the autopilot is ArduPilot; otherwise PX4.

    Attributes:
        switched_off: whether a command has put ArduPilot's fence out of force.
    """

    def __init__(self, missions: MissionStore, body: MockBody, parameters: Parameters, *, ardupilot: bool) -> None:
        self._missions, self._body, self._parameters, self._ardupilot = missions, body, parameters, ardupilot
        self._items: tuple[MissionItem, ...] = ()
        self._inclusions: list[Ring] = []
        self._exclusions: list[Ring] = []
        self._circles: list[tuple[float, float, float, bool]] = []
        self._floor_in_force = False
        self.switched_off = False

    @property
    def in_force(self) -> bool:
        """Whether the vehicle keeps to its fence: PX4 to any that it holds, ArduPilot by its parameter and by command."""
        return not self._ardupilot or bool(self._parameters["FENCE_ENABLE"] and not self.switched_off)

    @property
    def highest_m(self) -> float:
        """Height above home up to where ArduPilot returns while its fence has a ceiling; infinite without one."""
        get = self._parameters
        if not self._ardupilot or not get["FENCE_ENABLE"] or not int(get["FENCE_TYPE"]) & _HEIGHT:
            return math.inf
        return get["FENCE_ALT_MAX"] - get["FENCE_MARGIN"]

    def breach(self) -> str | None:
        """The limit that the believed position breaches, named as the autopilot names it; None inside all limits."""
        where = self._body.believed.position_m
        has_floor = self._ardupilot and self.in_force and int(self._parameters["FENCE_TYPE"]) & _FLOOR
        below = has_floor and self._below_floor(where[2] - self._body.home_m[2])
        return self._breach_at(where) or ("Min Alt" if below else None)

    def allows(self, position_m: Vector) -> bool:
        """Whether the limits in force hold at a position."""
        get = self._parameters
        has_floor = self._ardupilot and self.in_force and int(get["FENCE_TYPE"]) & _FLOOR
        if has_floor and position_m[2] - self._body.home_m[2] < get["FENCE_ALT_MIN"]:
            return False
        return self._breach_at(position_m) is None

    def _breach_at(self, where: Vector) -> str | None:
        items = self._missions.items(MissionType.FENCE)
        if items is not self._items:
            self._read(items, self._body.frame)
        up_m = where[2] - self._body.home_m[2]
        ardupilot, get = self._ardupilot, self._parameters
        if not self.in_force:
            return None
        kinds = int(get["FENCE_TYPE"]) if ardupilot else _HEIGHT | _CIRCLE | _AREAS
        highest_m = get["FENCE_ALT_MAX" if ardupilot else "GF_MAX_VER_DIST"]
        farthest_m = get["FENCE_RADIUS" if ardupilot else "GF_MAX_HOR_DIST"]
        if kinds & _HEIGHT and 0.0 < highest_m < up_m:
            return "Max Alt"
        if kinds & _CIRCLE and 0.0 < farthest_m < math.dist(where[:2], self._body.home_m[:2]):
            return "Circle"
        return "Polygon" if kinds & _AREAS and self._outside_areas(where) else None

    def _below_floor(self, up_m: float) -> bool:
        """The floor comes into force when the vehicle has climbed above it, and ends with the landing."""
        floor_m, body = self._parameters["FENCE_ALT_MIN"], self._body
        if body.on_ground or body.itinerary.landing:
            self._floor_in_force = False
        elif up_m >= floor_m + self._parameters["FENCE_MARGIN"]:
            self._floor_in_force = True
        return self._floor_in_force and up_m <= floor_m

    def _outside_areas(self, where: Vector) -> bool:
        x, y = where[0], where[1]
        wanted = [_inside(x, y, ring) for ring in self._inclusions]
        wanted += [math.hypot(x - e, y - n) <= r for e, n, r, inclusion in self._circles if inclusion]
        forbidden = [_inside(x, y, ring) for ring in self._exclusions]
        forbidden += [math.hypot(x - e, y - n) < r for e, n, r, inclusion in self._circles if not inclusion]
        return (bool(wanted) and not any(wanted)) or any(forbidden)

    def _read(self, items: tuple[MissionItem, ...], frame: LocalFrame) -> None:
        self._items = items
        fence: Fence = fence_from_items(items)

        def east_north(lat_deg: float, lon_deg: float) -> tuple[float, float]:
            east, north, _ = frame.enu_from_geodetic(lat_deg, lon_deg, frame.alt_amsl_m)[0]
            return float(east), float(north)

        rings = [
            (polygon.inclusion, tuple(east_north(v.lat_deg, v.lon_deg) for v in polygon.vertices))
            for polygon in fence.polygons
        ]
        self._inclusions = [ring for inclusion, ring in rings if inclusion]
        self._exclusions = [ring for inclusion, ring in rings if not inclusion]
        self._circles = [
            (*east_north(c.center.lat_deg, c.center.lon_deg), c.radius_m, c.inclusion) for c in fence.circles
        ]


def _inside(x: float, y: float, ring: Sequence[tuple[float, float]]) -> bool:
    """Whether a point is inside a ring (even-odd rule: counts the edges to its east)."""
    inside = False
    ax, ay = ring[-1]
    for bx, by in ring:
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        ax, ay = bx, by
    return inside
