"""What a way to falsify is, and the register of all of them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.falsifying.flown import Change, Flown

Meddle = Callable[[Path], Callable[[], object] | None]


@dataclass(frozen=True)
class Way:
    """One way to falsify a record.

    Attributes:
        name: with its parameters.
        because: why no vehicle can have flown this, or what it leaves unproved.
        change: of the record; none where other files are changed.
        rewrite: of the record's text, after ``change``.
        meddle: with the files of a run folder that holds the (changed) record; gives back what undoes it where it reaches
            outside that folder.
        beside: of the same record, for a second log that is judged together with it; none: there is one log.
        photos: the list of photos that tells the coverage, as a table; none: the record tells it.
        honest: whether it changes nothing that matters: then it has to pass as a foreign log.
        tells_velocity: whether it holds velocities. Another falsifier leaves them out, as they would give it away.
    """

    name: str
    because: str
    change: Change | None = None
    rewrite: Callable[[bytes], bytes] | None = None
    meddle: Meddle | None = None
    beside: Change | None = None
    photos: Callable[[Flown], str] | None = None
    honest: bool = False
    tells_velocity: bool = False
    family: str = field(default="", compare=False)

    @property
    def as_log_alone(self) -> bool:
        """Whether it can be judged as a foreign log only."""
        return self.honest or self.beside is not None

    @property
    def of_track(self) -> bool:
        """Whether it is a record that can be judged as a foreign log."""
        return self.change is not None or self.rewrite is not None

    def record(self, flown: Flown) -> bytes:
        """The falsified ``track.csv``."""
        if not (self.honest or self.tells_velocity):
            flown = replace(flown, velocity_ned_m_s=None)
        changed = flown if self.change is None else self.change(flown)
        text = changed.text().encode()
        return text if self.rewrite is None else self.rewrite(text)


Family = Callable[[Flown, np.random.Generator], Iterator[Way]]
"""Ways of one kind, their parameters drawn; none where a flight gives no occasion for them."""

FAMILIES: dict[str, Family] = {}


def family(name: str) -> Callable[[Family], Family]:
    """Register a family under a name."""

    def register(ways: Family) -> Family:
        FAMILIES[name] = ways
        return ways

    return register
