"""The id that a vehicle gives a list: another one whenever the list is another one (``opaque_id``, ``mission_id``)."""

import zlib
from collections.abc import Sequence

from mission_io.model.items import MissionItem


def id_of_items(items: Sequence[MissionItem]) -> int:
    """An id for a list: a checksum of its content, as PX4 has it; 0 for an empty list."""
    return zlib.crc32(repr(tuple(items)).encode()) if items else 0
