"""Reaction to a breach: one table of breach, phase and kind of vehicle (``data/breach_policy.toml``)."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache

from mission_io.data_tables import read_document
from uavcover.flight.precautions import OnBreach
from uavcover.model.outcome import Ending


class Phase(Enum):
    """The part of a flight in which a breach is judged."""

    OUTBOUND = "outbound"
    ROUTE = "route"
    INBOUND = "inbound"
    HOLD = "hold"
    RETURN = "return"


@dataclass(frozen=True, slots=True)
class PolicyCell:
    """One cell of the table."""

    simulated: OnBreach  # what is done with a vehicle that is proved to be simulated
    real: OnBreach  # what is done with any other
    choice: bool  # whether the user's ``--on-breach`` replaces it
    reason: str  # why, for the documentation


@cache
def policy() -> Mapping[tuple[Ending, Phase], PolicyCell]:
    """The table: a rule for each breach and phase with a reaction, or with a report only."""
    rules: dict[tuple[Ending, Phase], PolicyCell] = {}
    for row in read_document("uavcover/data/breach_policy.toml")["row"]:
        rule = PolicyCell(OnBreach(row["simulated"]), OnBreach(row["real"]), row["choice"], row["reason"])
        for phase in row["phase"]:
            rules[Ending[row["breach"].upper()], Phase(phase)] = rule
    return rules


def reaction(breach: Ending, phase: Phase, *, simulated: bool, chosen: OnBreach | None) -> OnBreach:
    """The reaction to a breach.

    Args:
        breach: what went wrong.
        phase: where in the flight.
        simulated: whether the vehicle is proved to be simulated.
        chosen: the user's ``--on-breach``; None where there is none.
    """
    rule = policy().get((breach, phase))
    if rule is None:
        return OnBreach.TELL
    if rule.choice and chosen is not None:
        return chosen
    return rule.simulated if simulated else rule.real
