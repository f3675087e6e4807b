"""ArduPilot's lists as files of the mock vehicle: made when they are opened, taken apart when they are closed."""

from mission_io.autopilots.autopilot import Autopilot, stored_item
from mission_io.errors import FormatError
from mission_io.formats.mission_dat import dat_path, read_mission_dat, write_mission_dat
from mission_io.model.items import MissionType
from mission_io.protocol.admission import list_is_whole, refusal_of
from mission_io.wire.mission_items import message_from_item
from uavcover.mock.mission_store import MissionStore


class ListFiles:
    """The files, as ``AP_Filesystem_Mission`` has them.

    A file that is no list changes nothing. An item that is refused ends a mission or rally points, whose old ones are gone by
    then; a fence is replaced as a whole or not at all. The writer is told nothing of it.

    Args:
        missions: The lists.
        autopilot: Whose rules apply.
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
