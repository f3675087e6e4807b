"""Evidence of a ground station's behaviour in one case, and the case itself."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from mission_io.conformance.case import ProtocolCase
from mission_io.conformance.tricks import Trick
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.messages import Address, Message


class Operation(Enum):
    """Operation that a ground station begins."""

    UPLOAD = "upload a list"
    EMPTY = "upload an empty list"
    CANCEL_UPLOAD = "upload a list and cancel it"
    DOWNLOAD = "download a list"
    CANCEL_DOWNLOAD = "download a list and cancel it"
    CLEAR = "clear a list"
    SET_CURRENT = "set the current item"


ON_REQUEST: Final = (Operation.CANCEL_UPLOAD, Operation.CANCEL_DOWNLOAD)
"""Only asked when the case is named: a ground station cannot know when to cancel."""


@dataclass(frozen=True, slots=True)
class HeardMessage:
    """A message of the ground station."""

    at_s: float
    message: Message


@dataclass(slots=True)
class StationEvidence:
    """Messages and states of one case."""

    operation: Operation  # what the station began
    mission_type: MissionType  # about which list
    station: Address  # who it is
    vehicle: Address  # whom it should talk to
    began_s: float
    old: tuple[MissionItem, ...]  # the list that the vehicle held before
    heard: list[HeardMessage] = field(default_factory=list)  # what it said in the mission protocol
    said: list[HeardMessage] = field(default_factory=list)  # what the vehicle said
    held: tuple[MissionItem, ...] = ()  # the list that it holds now
    reported_success: bool | None = None  # the station's report to its user; None when that is not known
    unending: bool = False  # whether the station was still at it when the time was up

    def of(self, *kinds: type[Message]) -> list[HeardMessage]:
        """The station's messages of some kinds, about the list."""
        return [h for h in self.heard if isinstance(h.message, kinds) and self._is_about(h.message)]

    def answered(self, *kinds: type[Message]) -> list[HeardMessage]:
        """The vehicle's messages of some kinds, about the list and to the station."""
        return [h for h in self.said if isinstance(h.message, kinds) and self._is_about(h.message)]

    def _is_about(self, message: Message) -> bool:
        return getattr(message, "mission_type", self.mission_type) == self.mission_type

    @property
    def lasted_s(self) -> float:
        """Seconds from the first to the last message of the station."""
        return self.heard[-1].at_s - self.began_s if self.heard else 0.0


@dataclass(frozen=True, slots=True)
class ClientCase(ProtocolCase[StationEvidence]):
    """A case for a ground station."""

    operation: Operation = Operation.UPLOAD  # what it has to begin
    trick: Callable[[], Trick] = Trick  # makes what the vehicle does wrong
    mission_type: MissionType | None = None  # the list that it has to be about; None for any
