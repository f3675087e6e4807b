"""A ground station in calls that wait: find the vehicle, upload, download, compare, clear, command. Nothing hangs."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from mission_io import commands
from mission_io.autopilots import Autopilot
from mission_io.checks import check_for_autopilot
from mission_io.clock import Clock
from mission_io.compare import Difference, compare_items
from mission_io.connection import Connection
from mission_io.content import Content, content_of, items_of, mission_type_of
from mission_io.errors import MisuseError, TransferError, TransferSilentError, VehicleHolds
from mission_io.items import MissionItem, MissionType
from mission_io.link import Link
from mission_io.messages import CommandAck, Message, ParamValue, Received
from mission_io.protocol.clear import Clear, ClearState
from mission_io.protocol.download import Download, DownloadState
from mission_io.protocol.exchange import Timing
from mission_io.protocol.upload import Upload, UploadState
from mission_io.verification import Verification

MessageT = TypeVar("MessageT", bound=Message)
Progress = Callable[[int, int], None]
"""Called with the number of items that are across and the number of all, when the first changes."""

NO_PROGRESS_S = 60.0
"""A transfer that answers but does not get on for this long is given up."""

_STALE_READ_BACK_S = 0.1
_ANSWER_S = 10.0
_CLEAR_TRIES = 3


class Client(Connection):
    """A ground station: a connection that can transfer missions and command the vehicle.

    Args:
        link: Carries the datagrams; ``close`` closes it.
        clock: Times everything; None takes the link's own.
        system_id: This side's MAVLink system; ground stations use 255.
        component_id: This side's component; 190 is a mission planner.
        timing: How patient transfers are.
        listener: Called with every message that arrives, whoever waits for it, with the time in seconds: for logs.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock | None = None,
        *,
        system_id: int = 255,
        component_id: int = 190,
        timing: Timing | None = None,
        listener: Callable[[Received, float], None] | None = None,
    ) -> None:
        super().__init__(link, clock, system_id=system_id, component_id=component_id, listener=listener)
        self.timing = timing if timing is not None else Timing()

    # Transfers.

    def upload(
        self,
        mission_type: MissionType,
        items: Sequence[MissionItem],
        *,
        progress: Progress | None = None,
        in_flight: bool = False,
    ) -> None:
        """Replace one of the vehicle's lists by ``items`` as they go on the wire (see ``wire_items``).

        When the final acknowledgement is lost or doubtful, the list is read back to find out.

        Raises:
            MisuseError: the vehicle is armed and ``in_flight`` was not said.
            TransferError: the vehicle refused or cancelled; ``vehicle_holds`` says what it has now.
            TransferSilentError: the vehicle stopped answering; also a VehicleSilentError.
        """
        self._refuse_armed("upload", in_flight=in_flight)
        now = self.clock.now()
        upload = Upload(
            items,
            mission_type=mission_type,
            local=self.local,
            vehicle=self.vehicle.address,
            timing=self.timing,
            now=now,
        )
        self._run(upload, lambda: upload.sent_count, len(items), progress)
        if upload.state is UploadState.ACCEPTED:
            return
        if upload.state is UploadState.UNCONFIRMED and self._holds(mission_type, items):
            return
        raise self._upload_error(upload, len(items))

    def download(self, mission_type: MissionType, *, progress: Progress | None = None) -> tuple[MissionItem, ...]:
        """One of the vehicle's lists, as it is on the wire (see ``mission_from_wire``).

        Raises:
            TransferError: the vehicle refused or cancelled.
            TransferSilentError: the vehicle stopped answering; also a VehicleSilentError.
            FormatError: the vehicle holds an item in a frame that mission_io does not know.
        """
        now = self.clock.now()
        download = Download(
            mission_type=mission_type, local=self.local, vehicle=self.vehicle.address, timing=self.timing, now=now
        )
        self._run(download, lambda: download.received_count, None, progress)
        if download.state is DownloadState.DONE:
            return download.items()
        got = f"{download.received_count} of {download.count} items"
        raise self._error(f"download of the {_name(mission_type)}", download, f"after {got}", "unchanged")

    def clear(self, mission_type: MissionType, *, in_flight: bool = False) -> None:
        """Empty one of the vehicle's lists, and read back that it is empty but for home.

        Raises:
            MisuseError: the vehicle is armed and ``in_flight`` was not said.
            TransferError: the vehicle refused, or says that it is done and is not.
            TransferSilentError: the vehicle did not answer; also a VehicleSilentError.
        """
        self._refuse_armed("clear", in_flight=in_flight)
        left = 0
        for _ in range(_CLEAR_TRIES):  # an acknowledgement may be a late one of an earlier upload
            self._clear_once(mission_type)
            left = len(self.download(mission_type))
            home_stays = self.vehicle.autopilot.home_in_item_0 and mission_type is MissionType.MISSION
            if left <= int(home_stays):
                return
        raise TransferError(
            f"clearing the {_name(mission_type)}: vehicle {self.vehicle.system_id} acknowledged and holds {left} items",
            vehicle_holds="unknown",
        )

    def upload_and_verify(
        self,
        content: Content,
        *,
        progress: Progress | None = None,
        in_flight: bool = False,
        autopilot: Autopilot | None = None,
    ) -> Verification:
        """Check, upload, read back and compare a mission, a fence or rally points.

        Args:
            content: What the vehicle is to hold.
            progress: Called while the items go across.
            in_flight: Whether an armed vehicle is meant.
            autopilot: Whose ways to expect; None takes the vehicle's own.

        Raises:
            MisuseError: the autopilot would refuse or misunderstand an item (nothing was sent), or the vehicle is armed.
            TransferError: as ``upload`` and ``download``.
        """
        autopilot = autopilot if autopilot is not None else self.vehicle.autopilot
        mission_type = mission_type_of(content)
        items = items_of(content, autopilot)
        problems = check_for_autopilot(items, autopilot, mission_type)
        if problems:
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            raise MisuseError(f"the {_name(mission_type)} was not sent: {problems[0]}{more}")
        self.upload(mission_type, items, progress=progress, in_flight=in_flight)
        received, differences = self._read_back(mission_type, items, autopilot)
        return Verification(mission_type, autopilot.name, items, received, differences)

    def download_content(self, mission_type: MissionType) -> Content:
        """One of the vehicle's lists as the Mission, Fence or RallyPoints it stands for; errors as ``download``."""
        return content_of(mission_type, self.download(mission_type), self.vehicle.autopilot)

    # Commands, modes, parameters: see mission_io.commands.

    def command(self, command: int, *params: float, timeout_s: float = _ANSWER_S) -> CommandAck:
        """Send a command until it is answered; see ``commands.send_command``."""
        return commands.send_command(self, command, params, timeout_s=timeout_s)

    def set_mode(self, custom_mode: int, *, timeout_s: float = _ANSWER_S) -> None:
        """Change the flight mode and see it in the heartbeat; see ``commands.set_mode``."""
        commands.set_mode(self, custom_mode, timeout_s=timeout_s)

    def request_message_interval(
        self, kind: type[Message], interval_s: float, *, timeout_s: float = _ANSWER_S
    ) -> CommandAck:
        """Ask for a kind of message each ``interval_s`` seconds."""
        return commands.request_message_interval(self, kind, interval_s, timeout_s=timeout_s)

    def request_message(self, kind: type[MessageT], *, timeout_s: float = _ANSWER_S) -> MessageT:
        """Ask for one message of a kind and wait for it."""
        return commands.request_message(self, kind, timeout_s=timeout_s)

    def read_parameter(self, name: str, *, timeout_s: float = _ANSWER_S) -> ParamValue:
        """Read a parameter by its name."""
        return commands.read_parameter(self, name, timeout_s=timeout_s)

    def set_parameter(
        self, name: str, value: float, *, param_type: int = 9, timeout_s: float = _ANSWER_S
    ) -> ParamValue:
        """Set a parameter and see that it is so."""
        return commands.set_parameter(self, name, value, param_type=param_type, timeout_s=timeout_s)

    # How transfers are driven, and what their ends mean.

    def _run(
        self, exchange: Upload | Download | Clear, done: Callable[[], int], total: int | None, progress: Progress | None
    ) -> None:
        reported, progress_at = -1, self.clock.now()
        try:
            while True:
                now = self.clock.now()
                for message in exchange.messages_to_send(now):
                    self.send(message)
                count = done()
                all_items = exchange.count if isinstance(exchange, Download) else total
                if count != reported and all_items is not None:
                    reported, progress_at = count, now
                    if progress is not None:
                        progress(count, all_items)
                wake = exchange.next_timer()
                if exchange.finished or wake is None:
                    return
                if now > progress_at + NO_PROGRESS_S:
                    raise TransferError(
                        f"vehicle {self.vehicle.system_id} answers but does not get on: item {count} for "
                        f"{NO_PROGRESS_S:g} s",
                        vehicle_holds="unknown",
                    )
                for received in self._next_messages(wake):
                    exchange.receive(received, self.clock.now())
        except KeyboardInterrupt:
            if not isinstance(exchange, Clear):
                exchange.cancel(self.clock.now())
                for message in exchange.messages_to_send(self.clock.now()):
                    self.send(message)
            raise

    def _clear_once(self, mission_type: MissionType) -> None:
        clear = Clear(
            mission_type=mission_type,
            local=self.local,
            vehicle=self.vehicle.address,
            timing=self.timing,
            now=self.clock.now(),
        )
        self._run(clear, lambda: 0, None, None)
        if clear.state is not ClearState.CLEARED:
            holds: VehicleHolds = "unchanged" if clear.state is ClearState.REFUSED else "unknown"
            raise self._error(f"clearing the {_name(mission_type)}", clear, "", holds)

    def _read_back(
        self, mission_type: MissionType, items: Sequence[MissionItem], autopilot: Autopilot
    ) -> tuple[tuple[MissionItem, ...], tuple[Difference, ...]]:
        """What the vehicle holds, against ``items``; read once more when it differs.

        PX4 gave back the list of before once in 60 times when it was read at once.
        """
        received = self.download(mission_type)
        differences = compare_items(items, received, autopilot, mission_type)
        if not all(difference.acceptable for difference in differences):
            deadline = self.clock.now() + _STALE_READ_BACK_S
            while self.clock.now() < deadline:
                self._next_messages(deadline)
            received = self.download(mission_type)
            differences = compare_items(items, received, autopilot, mission_type)
        return received, differences

    def _holds(self, mission_type: MissionType, items: Sequence[MissionItem]) -> bool:
        try:
            _, differences = self._read_back(mission_type, items, self.vehicle.autopilot)
        except TransferError:
            return False
        return all(difference.acceptable for difference in differences)

    def _upload_error(self, upload: Upload, total: int) -> TransferError:
        atomic = upload.mission_type in self.vehicle.autopilot.atomic
        holds: VehicleHolds = "unchanged" if atomic else "mixed"
        if upload.sent_count == 0 and not atomic:
            holds = "unchanged" if upload.state is UploadState.REFUSED else "unknown"
        elif upload.sent_count == total and upload.state is not UploadState.REFUSED:
            holds = "unknown"
        how_far = f"after {upload.sent_count} of {total} items; the vehicle's list is now {holds}"
        if upload.state is UploadState.UNCONFIRMED:
            how_far = f"and what was read back is not what was sent; {how_far}"
        return self._error(f"upload of the {_name(upload.mission_type)}", upload, how_far, holds)

    def _error(
        self, doing: str, exchange: Upload | Download | Clear, how_far: str, holds: VehicleHolds
    ) -> TransferError:
        result = exchange.last_result
        reason = f" with {getattr(result, 'name', result)}" if result else ""
        text = f"{doing}: vehicle {self.vehicle.system_id}: {exchange.state.value}{reason}"
        text += f" {how_far}" if how_far else ""
        silent = exchange.state in (UploadState.SILENT, DownloadState.SILENT, ClearState.SILENT)
        return (TransferSilentError if silent else TransferError)(text, vehicle_holds=holds)

    def _refuse_armed(self, what: str, *, in_flight: bool) -> None:
        if self.vehicle.armed and not in_flight:
            raise MisuseError(f"vehicle {self.vehicle.system_id} is armed; {what} only when in_flight is said")


def _name(mission_type: MissionType) -> str:
    return {MissionType.MISSION: "mission", MissionType.FENCE: "fence", MissionType.RALLY: "rally points"}[mission_type]
