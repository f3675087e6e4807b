"""MAVLink's own tables: which messages there are, how their payloads are laid out, and the checksum.

The only module that knows pymavlink.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as _dialect

CRC_EXTRAS: Final[Mapping[int, int]] = {number: kind.crc_extra for number, kind in _dialect.mavlink_map.items()}
"""For each message id of the dialect, the byte that goes last into its checksum."""

PAYLOAD_SIZES: Final[Mapping[int, int]] = {number: kind.unpacker.size for number, kind in _dialect.mavlink_map.items()}
"""For each message id of the dialect, the size of its payload with all extensions, in bytes."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How the payload of a kind of message is packed.

    Attributes:
        name: Its MAVLink name, in small letters.
        message_id: Its number.
        struct: Packs and unpacks the whole payload, extensions included.
        places: For each field, where its first value is among the values of ``struct``, and how many it has.
    """

    name: str
    message_id: int
    struct: Struct
    places: Mapping[str, tuple[int, int]]

    @property
    def value_count(self) -> int:
        """How many values ``struct`` packs."""
        return sum(count for _, count in self.places.values())

    def size_before(self, field: str) -> int:
        """The bytes of the payload before a field; before its first extension that is all MAVLink 1 has."""
        index = self.places[field][0]
        items = _format_items(self.struct.format)
        return Struct("<" + "".join(items[:index])).size


_LATER_EXTENSIONS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "mission_current": (("mission_id", "I"), ("fence_id", "I"), ("rally_points_id", "I")),
}
"""Extensions of the common message set that pymavlink's tables may lack, each with its format. Checksums do not know them."""


def layout_of(name: str) -> Layout:
    """The layout of a message by its MAVLink name, in small letters."""
    kind = getattr(_dialect, f"MAVLink_{name}_message")
    places: dict[str, tuple[int, int]] = {}
    start = 0
    for field, count in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
        places[field] = (start, count)
        start += count
    packed = kind.unpacker.format
    for field, letter in _LATER_EXTENSIONS.get(name, ()):
        if field not in places:
            places[field] = (start, 1)
            start, packed = start + 1, packed + letter
    return Layout(name, kind.id, Struct(packed), places)


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, the checksum of every MAVLink frame."""
    crc: int = _dialect.x25crc(data).crc
    return crc


def _format_items(text: str) -> list[str]:
    """One format for each value: ``<B50s2H`` is ``B``, ``50s``, ``H``, ``H``."""
    items: list[str] = []
    digits = ""
    for letter in text.removeprefix("<"):
        if letter.isdigit():
            digits += letter
            continue
        items.extend([digits + letter] if letter == "s" else [letter] * int(digits or 1))
        digits = ""
    return items
