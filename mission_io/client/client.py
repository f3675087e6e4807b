"""A ground station with blocking calls: find the vehicle, upload, download, compare, clear, command. Every call ends."""

import logging
from collections.abc import Callable, Sequence
from functools import partial

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import (
    MissionList,
    check_for_autopilot,
    items_of,
    mission_list_of,
    mission_type_of,
)
from mission_io.client import commands, mission_control
from mission_io.client.connection import Carry, Connection, Progress, Stop
from mission_io.client.peers import two_in_one
from mission_io.client.transfer_outcome import (
    PROVEN_BY_READING,
    ReadBack,
    TransferredList,
    description,
    failure,
    held_as_read,
    held_by_design,
    items_on_card,
    list_name,
)
from mission_io.errors import (
    CommandRefusedError,
    FormatError,
    MisuseError,
    TransferCancelledError,
    TransferError,
    TransferInterrupted,
    TransferSilentError,
    VehicleHolds,
    VehicleSilentError,
)
from mission_io.links.datagrams import Clock, Link
from mission_io.model.enums import AutopilotId
from mission_io.model.items import MissionItem, MissionType
from mission_io.model.plain_text import counted
from mission_io.protocol.download import Download, DownloadState
from mission_io.protocol.exchange import Clear, ClearState, ExchangeOptions
from mission_io.protocol.tables import UploadState
from mission_io.protocol.terrain import TerrainAnswers
from mission_io.protocol.timing import CALLS, TRANSFERS, RetryLimits, Timing
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import Received
from mission_io.wire.telemetry_messages import TerrainRequest

_log = logging.getLogger(__name__)


class Client(Connection):
    """A ground station: a connection that can transfer missions and command the vehicle.

    Args:
        link: Carries the datagrams; ``close`` closes it.
        clock: Source of time; None uses the link's own.
        system_id: This side's MAVLink system; ground stations use 255.
        component_id: This side's component; 190 is a mission planner.
        timing: Time-outs of transfers; see ``link_preset`` for kinds of links.
        listener: Called with every message that arrives and the time in seconds, for logs.

    Attributes:
        retry_limits: What transfers have learnt about the link so far, such as its round-trip time.
        transferred: Of each list that was transferred whole, the number of its items and the vehicle's id of it; see
            ``mission_io.client.lists``.
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
        self.retry_limits = RetryLimits()
        self.transferred: dict[MissionType, TransferredList] = {}

    # Transfers.

    def upload(
        self,
        mission_type: MissionType,
        items: Sequence[MissionItem],
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
        in_flight: bool = False,
    ) -> None:
        """Replace one of the vehicle's lists by ``items``, given as sent on the wire (see ``wire_items``).

        When the final acknowledgement is lost or doubtful, the list is read back to find out. After a failed or cancelled
        upload it is read back to state what the vehicle holds now.

        Raises:
            MisuseError: the vehicle is armed and ``in_flight`` is False.
            TransferError: the vehicle refused, cancelled, or made no progress; ``vehicle_holds`` and ``held_items`` say
                what it holds now.
            TransferCancelledError: ``stop`` returned True.
            TransferSilentError: the vehicle stopped answering; also a VehicleSilentError.
            TransferInterrupted: Ctrl-C; a KeyboardInterrupt that knows what the vehicle holds now.
        """
        self._refuse_armed("upload", in_flight=in_flight)
        self.transferred.pop(mission_type, None)
        upload = Upload(items, **self.exchange_options(mission_type))
        interrupted = self._run(upload, lambda: (upload.across_count, len(items)), progress, stop)
        if upload.state is UploadState.ACCEPTED:
            self.transferred[mission_type] = TransferredList(len(items), upload.list_id)
            return
        error = self._upload_failure(upload, items)
        if interrupted:
            raise TransferInterrupted(error)
        if upload.state not in PROVEN_BY_READING or error.vehicle_holds != "replaced":
            raise error

    def download(
        self, mission_type: MissionType, *, progress: Progress | None = None, stop: Stop | None = None
    ) -> tuple[MissionItem, ...]:
        """Download one of the vehicle's lists, as it is on the wire (see ``mission_from_wire``).

        Raises:
            TransferError: the vehicle refused, cancelled, or made no progress.
            TransferCancelledError: ``stop`` returned True.
            TransferSilentError: the vehicle stopped answering; also a VehicleSilentError.
            FormatError: the vehicle holds an item in a frame that mission_io does not know, or at a position that is none; it
                names the item and the field.
        """
        # A vehicle that keeps no state about a download serves items in any order.
        autopilot = self.known_autopilot
        any_order = autopilot is not None and autopilot.download_blocks_s == 0.0
        in_order = autopilot is not None and not any_order
        download = Download(any_order=any_order, in_order=in_order, **self.exchange_options(mission_type))
        interrupted = self._run(download, lambda: (download.received_count, download.count), progress, stop)
        if download.state is DownloadState.DONE:
            self.transferred[mission_type] = TransferredList(download.received_count, download.list_id)
            return download.items()
        got = f"after {download.received_count} of {download.count} items" if download.count is not None else ""
        doing = f"download of the {list_name(mission_type)}"
        error = failure(doing, download, got, vehicle_holds="unchanged", advice=self.signing_advice())
        raise TransferInterrupted(error) if interrupted else error

    def clear(self, mission_type: MissionType, *, in_flight: bool = False) -> None:
        """Clear one of the vehicle's lists, and read back that it is empty except for home.

        Raises:
            MisuseError: the vehicle is armed and ``in_flight`` is False.
            TransferError: the vehicle refused, made no progress, or acknowledged without clearing; ``held_items`` says
                what it holds now.
            TransferSilentError: the vehicle did not answer; also a VehicleSilentError.
        """
        self._refuse_armed("clear", in_flight=in_flight)
        left: tuple[MissionItem, ...] = ()
        for _ in range(TRANSFERS.clear_tries):  # the acknowledgement may be a late one of an earlier upload
            self._clear_once(mission_type)
            try:
                left = self.download(mission_type)
            except (TransferError, FormatError) as error:
                kind = TransferSilentError if isinstance(error, TransferSilentError) else TransferError
                raise kind(
                    f"clearing the {list_name(mission_type)}: vehicle {self.vehicle.system_id} acknowledged, but the "
                    f"list could not be read back: {error}",
                    vehicle_holds="unknown",
                ) from None
            autopilot = self.known_autopilot
            home_stays = autopilot is not None and autopilot.home_in_item_0 and mission_type is MissionType.MISSION
            if len(left) <= int(home_stays):
                return
        raise TransferError(
            f"clearing the {list_name(mission_type)}: vehicle {self.vehicle.system_id} acknowledged, but still has "
            f"{counted(len(left), 'item')}",
            vehicle_holds="unknown",
            held_items=left,
        )

    def upload_and_verify(
        self,
        content: MissionList,
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
        in_flight: bool = False,
        autopilot: Autopilot | None = None,
        carry: Carry | None = None,
    ) -> ReadBack:
        """Check, upload, read back and compare a mission, a fence or rally points.

        When a mission exceeds the known item limit of its autopilot, the vehicle's own limit is requested.

        Args:
            content: The list that the vehicle should hold.
            progress: Called during the upload.
            stop: Polled; True cancels.
            in_flight: Allow an upload to an armed vehicle.
            autopilot: The autopilot whose behaviour to expect; None uses the vehicle's own.
            carry: Brings the items to the vehicle; ``upload`` by default.

        Raises:
            MisuseError: the autopilot would refuse or misunderstand an item (nothing was sent), or the vehicle is armed.
            TransferError: as ``upload`` and ``download``.
        """
        autopilot = autopilot if autopilot is not None else self.vehicle.autopilot
        mission_type = mission_type_of(content)
        items = items_of(content, autopilot)
        long = autopilot.item_limit is not None and len(items) > autopilot.item_limit
        limit = self.ask_item_limit() if long and mission_type is MissionType.MISSION else None
        problems = check_for_autopilot(items, autopilot, mission_type, item_limit=limit)
        if problems:
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            raise MisuseError(f"the {list_name(mission_type)} was not sent: {problems[0]}{more}")
        self._refuse_armed("upload", in_flight=in_flight)
        (carry or partial(self.upload, progress=progress, stop=stop, in_flight=in_flight))(mission_type, items)
        try:
            return self._read_back(mission_type, items, autopilot, stop)
        except TransferCancelledError as error:
            raise TransferCancelledError(
                f"the {list_name(mission_type)} was uploaded, but could not be read back and compared: {error}",
                vehicle_holds="unknown",
            ) from None

    def ask_item_limit(self, *, timeout_s: float = CALLS.item_limit_s) -> int | None:
        """The number of mission items the vehicle accepts, home included; None without an answer within ``timeout_s``."""
        card_parameter = self.vehicle.autopilot.card_parameter
        if card_parameter is None:
            return None
        try:
            return items_on_card(self.read_parameter(card_parameter, timeout_s=timeout_s).value)
        except VehicleSilentError:  # a vehicle without a card slot gives no answer
            return None

    def download_list(
        self, mission_type: MissionType, *, progress: Progress | None = None, stop: Stop | None = None
    ) -> MissionList:
        """Download one of the vehicle's lists as a Mission, Fence or RallyPoints; errors as ``download``."""
        items = self.download(mission_type, progress=progress, stop=stop)
        return mission_list_of(mission_type, items, self.vehicle.autopilot)

    # Commands, modes and parameters, and flying what the vehicle holds.

    command = commands.send_command
    set_mode = commands.set_mode
    request_message_interval = commands.request_message_interval
    request_message = commands.request_message
    read_parameter = commands.read_parameter
    set_parameter = commands.set_parameter
    set_current = mission_control.set_current
    start_mission = mission_control.start_mission
    pause_mission = mission_control.pause_mission
    resume_mission = mission_control.resume_mission
    follow_mission = mission_control.follow_mission

    # Running transfers, and the meaning of their outcomes.

    def exchange_options(self, mission_type: MissionType) -> ExchangeOptions:
        """The arguments of an exchange with the vehicle."""
        return ExchangeOptions(
            mission_type=mission_type, local=self.local, vehicle=self.vehicle.address, now=self.clock.now(),
            timing=self.timing, retry_limits=self.retry_limits,
        )  # fmt: skip

    def _run(
        self,
        exchange: Upload | Download | Clear,
        counts: Callable[[], tuple[int, int | None]],
        progress: Progress | None,
        stop: Stop | None,
    ) -> bool:
        """Run an exchange to its end; True after a Ctrl-C, which cancels the exchange instead of dropping it.

        Args:
            exchange: The exchange.
            counts: Returns the number of items transferred, and the total if known.
            progress: Called when the first changes.
            stop: Polled; True cancels.
        """
        interrupted = False
        while True:
            try:
                self.run(exchange, counts, progress=progress, stop=stop)
                return interrupted
            except KeyboardInterrupt:
                if interrupted or isinstance(exchange, Clear):
                    raise
                interrupted, progress, stop = True, None, None
                exchange.cancel(self.clock.now())
            finally:
                self.retry_limits = exchange.retry_limits

    def _clear_once(self, mission_type: MissionType) -> None:
        clear = Clear(**self.exchange_options(mission_type))
        self._run(clear, lambda: (0, None), None, None)
        if clear.state is ClearState.CLEARED:
            return
        holds: VehicleHolds = "unchanged" if clear.state is ClearState.REFUSED else "unknown"
        held, now_held = None, ""
        if clear.state is not ClearState.SILENT:
            held = self._held(mission_type)
            now_held = "" if held is None else f"; the vehicle now has {counted(len(held), 'item')}"
        doing = f"clearing the {list_name(mission_type)}"
        raise failure(doing, clear, now_held, vehicle_holds=holds, held_items=held, advice=self.signing_advice())

    def _held(self, mission_type: MissionType) -> tuple[MissionItem, ...] | None:
        """The list on the vehicle after a failure; None when it cannot be read."""
        try:
            return self.download(mission_type)
        except (TransferError, FormatError) as error:
            _log.info("the list on the vehicle could not be read back: %s", error)
            return None

    def _read_back(
        self, mission_type: MissionType, items: Sequence[MissionItem], autopilot: Autopilot, stop: Stop | None = None
    ) -> ReadBack:
        """Compare what the vehicle holds with what was sent; read once more when it differs.

        PX4 returned the previous list once in 60 times when it was read immediately.
        """
        received = self.download(mission_type, stop=stop)
        differences = compare_items(items, received, autopilot, mission_type)
        if not all(difference.acceptable for difference in differences):
            self._wait(TRANSFERS.stale_read_back_s)
            received = self.download(mission_type, stop=stop)
            differences = compare_items(items, received, autopilot, mission_type)
        return ReadBack(mission_type, autopilot.name, tuple(items), received, differences)

    def _upload_failure(self, upload: Upload, items: Sequence[MissionItem]) -> TransferError:
        """The error for an upload that was not acknowledged, with what the vehicle holds now."""
        autopilot, mission_type = self.known_autopilot, upload.mission_type
        holds: VehicleHolds = "unknown" if autopilot is None else held_by_design(upload, len(items), autopilot)
        held, unread = None, ""
        silent = upload.state is UploadState.SILENT
        nothing_began = upload.state is UploadState.REFUSED and upload.sent_count == 0
        if not silent and not nothing_began:
            try:
                if autopilot is None:
                    held = self.download(mission_type)
                else:
                    held = self._read_back(mission_type, items, autopilot).received
                    holds = held_as_read(upload, items, held, autopilot)
            except TransferSilentError:
                silent = True
            except (TransferError, FormatError) as why:
                unread = f" (it could not be read back: {why})"
        how_far = f"after {upload.across_count} of {len(items)} items"
        if upload.state in PROVEN_BY_READING and held is not None:
            how_far = f"and the downloaded list differs from the uploaded list; {how_far}"
        how_far += f"; {description(holds, items, held, autopilot, mission_type)}{unread}"
        doing, advice = f"upload of the {list_name(mission_type)}", self.signing_advice()
        error = failure(doing, upload, how_far, vehicle_holds=holds, held_items=held, advice=advice)
        if silent and not isinstance(error, TransferSilentError | TransferCancelledError):
            return TransferSilentError(f"{error} (the vehicle stopped answering){advice}", vehicle_holds=holds)
        return error

    def _refuse_armed(self, what: str, *, in_flight: bool) -> None:
        if self.impostor is not None and not in_flight:
            raise MisuseError(f"{two_in_one(self.vehicle, self.impostor)}; nothing was sent")
        if self.vehicle.armed and not in_flight:
            raise MisuseError(f"vehicle {self.vehicle.system_id} is armed; {what} requires in_flight=True")


def answer_terrain_requests(client: Client, answers: TerrainAnswers) -> None:
    """Answer the vehicle's requests from now on, and have it send them.

    ArduPilot sends TERRAIN_REQUEST only on links that have asked for that message, or for the stream it belongs to. A vehicle
    without terrain refuses, which is no error: it has no requests either.
    """
    if answers not in client.services:
        client.services.append(answers)
    if client.vehicle.mav_autopilot != AutopilotId.ARDUPILOT:
        return
    try:
        client.request_message_interval(TerrainRequest, CALLS.terrain_every_s, timeout_s=CALLS.terrain_answer_s)
    except (CommandRefusedError, VehicleSilentError) as error:
        _log.info("the vehicle may not request terrain heights: %s", error)
