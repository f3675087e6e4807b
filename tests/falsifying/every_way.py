"""All ways to falsify one flight, by a seed."""

import dataclasses
from collections.abc import Collection

import numpy as np

from tests.falsifying import (  # noqa: F401  (they register their families)
    of_columns,
    of_files,
    of_motion,
    of_position,
    of_time,
    of_unreported_photos,
    of_velocity,
)
from tests.falsifying.flown import Flown
from tests.falsifying.way import FAMILIES, Way

COMBINED = "two at once"
_NOT_COMBINED = ("honest", "velocity", "violations hidden", "text")


def every_way(flown: Flown, *, seed: int, families: Collection[str] = (), combined: int = 12) -> list[Way]:
    """The ways of the families that were named, by default of all; the same for the same seed.

    Args:
        flown: the flight; it decides which ways there are.
        seed: of the parameters.
        families: names of families.
        combined: how many pairs of changes of a track there are beside them.
    """
    found: list[Way] = []
    for number, (name, ways) in enumerate(FAMILIES.items()):
        rng = np.random.default_rng([seed, number])
        if not families or name in families:
            found += [dataclasses.replace(way, family=name) for way in ways(flown, rng)]
    if not families or COMBINED in families:
        found += _pairs(flown, np.random.default_rng([seed, 10_000]), combined)
    return found


def _pairs(flown: Flown, rng: np.random.Generator, count: int) -> list[Way]:
    """Two changes of different families, one after the other."""
    single = [
        dataclasses.replace(way, family=name)
        for number, (name, ways) in enumerate(FAMILIES.items())
        if name not in _NOT_COMBINED
        for way in ways(flown, np.random.default_rng([int(rng.integers(2**31)), number]))
        if way.change is not None and way.meddle is None and way.beside is None
    ]
    pairs: list[Way] = []
    while len(pairs) < count:
        first, second = (single[k] for k in rng.choice(len(single), 2, replace=False))
        if first.family != second.family:
            pairs.append(_pair(first, second))
    return pairs


def _pair(first: Way, second: Way) -> Way:
    one, other = first.change, second.change
    assert one is not None
    assert other is not None
    return Way(
        f"{first.family}: {first.name}; {second.family}: {second.name}", f"{first.because}; {second.because}",
        lambda f: other(one(f)), family=COMBINED,
    )  # fmt: skip
