"""What can go wrong in the harness itself; a vehicle that does otherwise is a result, not an error."""


class SitlError(Exception):
    """Root of the harness's errors."""


class MatrixError(SitlError):
    """``matrix.toml`` is not what the harness understands."""


class SimulatorError(SitlError):
    """A simulator that does not start, or ends too soon."""


class MissingSimulatorError(SitlError):
    """No simulator was named; the message says which variable to set."""


class CheckFailedError(SitlError):
    """A vehicle, or our side, did not do what the capability asks; the message has the figures."""


def require(holds: bool, otherwise: str) -> None:
    """Go on only when a check holds.

    Raises:
        CheckFailedError: it does not; ``otherwise`` is the message.
    """
    if not holds:
        raise CheckFailedError(otherwise)
