"""The errors of mission_io: one root, and one class for each way a mission can fail to reach the vehicle."""

from typing import Any, Literal

VehicleHolds = Literal["unchanged", "replaced", "mixed", "unknown"]
"""The state of the vehicle's list after a failed transfer."""


class MissionIoError(Exception):
    """Root of every error that mission_io raises on purpose."""


class FormatError(MissionIoError):
    """Text or items that cannot be read as a mission.

    Attributes:
        what: What is wrong.
        where: The line, row, item or field; empty when it is the whole.
        advice: What to do about it; empty when that is obvious.
    """

    def __init__(self, what: str, *, where: str = "", advice: str = "") -> None:
        self.what, self.where, self.advice = what, where, advice
        super().__init__((f"{where}: " if where else "") + what + (f"; {advice}" if advice else ""))


class MisuseError(MissionIoError):
    """Wrong use by this side: a wrong argument, or a call at the wrong time."""


class AmbiguousVehicleError(MisuseError):
    """Several vehicles are on the link and none was named.

    Attributes:
        vehicles: The VehicleInfo of each.
    """

    def __init__(self, message: str, *, vehicles: tuple[Any, ...]) -> None:
        self.vehicles = vehicles
        super().__init__(message)


class LinkError(MissionIoError):
    """The link cannot be opened, or the operating system refused to send or receive."""


class VehicleSilentError(MissionIoError):
    """The vehicle did not answer in time."""


class TransferError(MissionIoError):
    """A mission transfer that the vehicle ended, or that fell silent.

    Attributes:
        vehicle_holds: What the vehicle holds now, as far as it is known.
        held_items: The MissionItems read back from it, as on the wire; None when they could not be read.
        refusal: The MAV_MISSION_RESULT with which the vehicle refused; None when the transfer ended otherwise.
    """

    def __init__(
        self,
        message: str,
        *,
        vehicle_holds: VehicleHolds,
        held_items: tuple[Any, ...] | None = None,
        refusal: int | None = None,
    ) -> None:
        self.vehicle_holds: VehicleHolds = vehicle_holds
        self.held_items = held_items
        self.refusal = refusal
        super().__init__(message)


class TransferSilentError(TransferError, VehicleSilentError):
    """A mission transfer in which the vehicle stopped answering."""


class TransferCancelledError(TransferError):
    """A mission transfer that this side cancelled."""


class WaitCancelledError(MissionIoError):
    """This side gave up waiting for an answer; the vehicle may have received what was sent."""


class TransferInterrupted(KeyboardInterrupt):
    """Ctrl-C during a transfer; the vehicle received a cancellation.

    Attributes:
        outcome: What the vehicle holds now.
    """

    def __init__(self, outcome: TransferError) -> None:
        self.outcome = outcome
        super().__init__(str(outcome))


class CommandRefusedError(MissionIoError):
    """The vehicle answered a command with something other than "accepted".

    Attributes:
        command: The MAV_CMD number.
        result: The MAV_RESULT number.
        result_name: The name of that result, for instance ``DENIED``.
    """

    def __init__(self, message: str, *, command: int, result: int, result_name: str) -> None:
        self.command, self.result, self.result_name = command, result, result_name
        super().__init__(message)
