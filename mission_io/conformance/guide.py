"""The sections of the MAVLink mission guide that the cases quote by name, with their addresses."""

from enum import Enum
from typing import Final

GUIDE: Final = "https://mavlink.io/en/services/mission.html"


class Section(Enum):
    """A section of the guide; the value is its heading."""

    TYPES = "Mission Types"
    ITEMS = "Mission Items (MAVLink Commands)"
    MESSAGES = "Message/Enum Summary"
    DEPRECATED = "Deprecated Types: MISSION_ITEM"
    FRAMES = "Frames & Positional Information"
    CHANGES = "Detecting Mission/Plan Changes"
    UPLOAD = "Upload a Mission to the Vehicle"
    DOWNLOAD = "Download a Mission from the Vehicle"
    CURRENT = "Set Current Mission Item"
    PROGRESS = "Monitor Mission Progress"
    CLEAR = "Clear Missions"
    CANCEL = "Canceling Operations"
    TIMEOUTS = "Timeouts and Retries"
    ERRORS = "Errors/Completion"
    ROUTING = "MAVLink Routing"
    """Another page: who a message is for."""

    @property
    def url(self) -> str:
        """Where to read it."""
        return _ADDRESSES[self]


_ADDRESSES: Final = {
    Section.TYPES: f"{GUIDE}#mission_types",
    Section.ITEMS: f"{GUIDE}#mavlink_commands",
    Section.MESSAGES: f"{GUIDE}#message-enum-summary",
    Section.DEPRECATED: f"{GUIDE}#command_message_type",
    Section.FRAMES: f"{GUIDE}#frames-positional-information",
    Section.CHANGES: f"{GUIDE}#detecting-mission-plan-changes",
    Section.UPLOAD: f"{GUIDE}#uploading_mission",
    Section.DOWNLOAD: f"{GUIDE}#download_mission",
    Section.CURRENT: f"{GUIDE}#current_mission_item",
    Section.PROGRESS: f"{GUIDE}#monitor_progress",
    Section.CLEAR: f"{GUIDE}#clear_mission",
    Section.CANCEL: f"{GUIDE}#cancel",
    Section.TIMEOUTS: f"{GUIDE}#timeout",
    Section.ERRORS: f"{GUIDE}#errors",
    Section.ROUTING: "https://mavlink.io/en/guide/routing.html",
}
