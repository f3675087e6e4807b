"""A ground station's answers to TERRAIN_REQUEST: the heights of the requested parts, as far as they are known.

Sans-IO: requests go in, messages come out, and the clock is an argument. Only a bounded number of blocks waits; a vehicle
requests what it lacks again every two seconds.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from mission_io.autopilots.terrain_grid import ALL_PARTS, PART_COUNT, Heights, Part, parts_of_block, places_of_block
from mission_io.errors import MisuseError
from mission_io.protocol.tuning import VALUES
from mission_io.wire.messages import Message, Received, TerrainData, TerrainRequest

_MAX_REMEMBERED = 100 * VALUES.max_waiting

_Key = tuple[float, float, int]
"""A block as it is requested: latitude and longitude of its corner, and spacing."""


@dataclass(frozen=True, slots=True)
class TerrainCounts:
    """Counts of the requests by their outcome."""

    requests: int = 0  # requests that arrived
    blocks: int = 0  # different blocks that were requested
    blocks_incomplete: int = 0  # those of them with heights that are not known
    parts_sent: int = 0  # parts that were sent, again where they were requested again
    parts_unknown: int = 0  # requested parts that were not sent because a height in them is not known
    refused: int = 0  # requests that make no sense
    crowded_out: int = 0  # requests that were dropped because too many blocks were waiting


class TerrainAnswers:
    """Answers a vehicle's requests for terrain heights.

    Heights are rounded to the nearest metre, which is what TERRAIN_DATA carries. A part with an unknown height is not sent.

    Args:
        heights_amsl_m: The ground.
        parts_per_s: Parts sent in a second, 55 bytes each: the default takes a third of a radio with 57,600 baud.
        say: Receives a message at the first requests that could not be answered.

    Raises:
        MisuseError: a rate that is not above 0.
    """

    def __init__(
        self, heights_amsl_m: Heights, *, parts_per_s: float = 35.0, say: Callable[[str], None] | None = None
    ) -> None:
        if not 0.0 < parts_per_s < math.inf:
            raise MisuseError(f"parts_per_s must be greater than 0, not {parts_per_s}")
        self._heights, self._interval_s = heights_amsl_m, 1.0 / parts_per_s
        self._say = say
        self._due_s = -math.inf
        self._waiting: dict[_Key, int] = {}
        self._parts: dict[_Key, tuple[Part | None, ...]] = {}
        self._met: set[_Key] = set()
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> TerrainCounts:
        """Counts of the requests by their outcome."""
        return TerrainCounts(**self._counts)

    def receive(self, received: Received, now: float) -> None:
        """Take a message of the vehicle; anything but a TERRAIN_REQUEST is ignored."""
        request = received.message
        if not isinstance(request, TerrainRequest):
            return
        self._counts["requests"] += 1
        mask = request.mask & ALL_PARTS
        if not (abs(request.lat_deg) <= 90.0 and abs(request.lon_deg) <= 180.0 and request.spacing_m > 0 and mask):
            self._count_and_tell(
                "refused",
                f"an invalid request for terrain heights was not answered: latitude {request.lat_deg:g}, longitude "
                f"{request.lon_deg:g}, spacing {request.spacing_m} m, mask {request.mask:#x}",
            )
            return
        key = (request.lat_deg, request.lon_deg, request.spacing_m)
        if key not in self._waiting and len(self._waiting) >= VALUES.max_waiting:
            self._counts["crowded_out"] += 1
            return
        if not self._waiting:
            self._due_s = max(self._due_s, now)
        self._waiting[key] = mask

    def messages_to_send(self, now: float) -> list[Message]:
        """Messages due: a part each ``1 / parts_per_s`` seconds while some wait; an unknown block takes a turn."""
        due: list[Message] = []
        self._due_s = max(self._due_s, now - VALUES.latest_s)
        while self._waiting and now >= self._due_s:
            self._due_s += self._interval_s
            due += self._next_part(next(iter(self._waiting)))
        return due

    def next_timer(self) -> float | None:
        """When the next part is due; None while nothing is waiting."""
        return self._due_s if self._waiting else None

    def _next_part(self, key: _Key) -> list[TerrainData]:
        """The next part of a block that is known; none when no more of them is."""
        parts, mask = self._parts_of(key), self._waiting[key]
        found: list[TerrainData] = []
        for part in range(PART_COUNT):
            if found or not mask >> part & 1:
                continue
            mask &= ~(1 << part)
            heights = parts[part]
            if heights is None:
                self._counts["parts_unknown"] += 1
            else:
                self._counts["parts_sent"] += 1
                found.append(TerrainData(*key, part, heights))
        if mask:
            self._waiting[key] = mask
        else:
            del self._waiting[key]
        return found

    def _parts_of(self, key: _Key) -> tuple[Part | None, ...]:
        """The heights of a block; computed at its turn, and kept for the next request."""
        parts = self._parts.get(key)
        if parts is None:
            if len(self._parts) >= VALUES.max_waiting:
                del self._parts[next(iter(self._parts))]
            parts = self._parts[key] = parts_of_block(places_of_block(*key), self._heights)
            self._meet(key, sum(part is None for part in parts))
        return parts

    def _meet(self, key: _Key, lacking: int) -> None:
        """Note a block the first time; a flood of them fills no memory, and the oldest are then counted again."""
        if key in self._met:
            return
        if len(self._met) >= _MAX_REMEMBERED:
            self._met.clear()
        self._met.add(key)
        self._counts["blocks"] += 1
        if lacking:
            self._count_and_tell(
                "blocks_incomplete",
                f"no elevation data for {lacking} of the {PART_COUNT} parts of the terrain block that begins at "
                f"latitude {key[0]:.5f}, longitude {key[1]:.5f} (grid spacing {key[2]} m), so they are not sent, and "
                "the vehicle keeps waiting for them",
            )

    def _count_and_tell(self, kind: str, text: str) -> None:
        self._counts[kind] += 1
        if self._say is not None and self._counts[kind] <= VALUES.reported_blocks:
            self._say(text)
