"""Reading the mission back while it is flown, without getting in the way of the flight."""

from collections.abc import Callable

from mission_io.autopilots import wire_items
from mission_io.compare import compare_items, fault_text
from mission_io.errors import FormatError, MissionIoError, TransferCancelledError
from mission_io.items import MissionType
from uavcover.flight.conversation import Conversation, Timer
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan

_EVERY_S = 60.0
"""Vehicle time between two readings that nothing has asked for."""
_BUSY_SHARE = 0.1
"""Readings that nothing has asked for take no more of the link's time than this."""
_LONGEST_S = 120.0
_AGAIN_S = 5.0
_LOOK_S = 0.1


class MissionReading:
    """Compares the mission that the vehicle holds with the planned one: when there is a sign of a change, and every minute.

    Positions that arrive meanwhile are recorded as ever, and what has to be looked at all the time is looked at. The user's
    stop or pause ends a reading at once. One that fails is tried again, later each time.

    Args:
        conversation: with the vehicle.
        plan: what it is to fly.
        meanwhile: what else has to be done all the time.
    """

    def __init__(self, conversation: Conversation, plan: FlightPlan, meanwhile: Callable[[], None]) -> None:
        self._conversation, self._meanwhile = conversation, meanwhile
        self._wanted = wire_items(plan.mission, conversation.autopilot)
        self._every = Timer(conversation, _EVERY_S)
        self._asked = False
        self._failures = 0
        self._not_before_s = self._rest_until_s = 0.0

    def ask(self) -> None:
        """There is a sign of a change: read as soon as may be."""
        self._asked = True

    @property
    def due(self) -> bool:
        """Whether it is time to read."""
        now = self._conversation.client.clock.now()
        return now >= self._not_before_s and (self._asked or (self._every.over and now >= self._rest_until_s))

    def difference(self) -> str | None:
        """The largest difference from the planned mission; None when there is none, or when it could not be read.

        Raises:
            FlightFaultError: the vehicle is gone, or it restarted.
        """
        conversation, began_s = self._conversation, self._conversation.client.clock.now()
        stops, pause = conversation.stop(), conversation.pause()
        self._asked = False

        looked_s = began_s

        def stop() -> bool:
            nonlocal looked_s
            now = conversation.client.clock.now()
            if now - looked_s < _LOOK_S:  # asked after every message; a busy vehicle sends thousands
                return False
            looked_s = now
            conversation.attend()
            self._meanwhile()
            wanted_else = conversation.stop() != stops or conversation.pause() != pause
            return wanted_else or now - began_s > _LONGEST_S

        try:
            held = conversation.client.download(MissionType.MISSION, stop=stop)
        except FormatError as error:
            held = None
            difference = f"it holds what no plan has: {error}"
        except TransferCancelledError:
            if conversation.client.clock.now() - began_s > _LONGEST_S:
                self._note_failure(f"not read in {_LONGEST_S:g} s")
            self._asked = True
            return None
        except MissionIoError as error:
            self._note_failure(str(error))
            return None
        now = conversation.client.clock.now()
        if self._failures:
            conversation.tell(EventKind.WARNING, "the mission has been read back again")
        self._failures = 0
        self._rest_until_s = now + (now - began_s) / _BUSY_SHARE
        self._not_before_s = now + max(1.0, now - began_s)
        self._every.restart()
        if held is None:
            return difference
        return fault_text(compare_items(self._wanted, held, conversation.autopilot))

    def _note_failure(self, why: str) -> None:
        """Try again later; told the first time."""
        if not self._failures:
            self._conversation.tell(
                EventKind.WARNING, f"the mission could not be read back in flight: {why}; tried again"
            )
        self._not_before_s = self._conversation.client.clock.now() + _AGAIN_S * 2.0 ** min(self._failures, 4)
        self._failures += 1
        self._asked = True
