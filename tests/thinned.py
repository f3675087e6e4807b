"""Tests with several axes of parameters: in the quick run as many cases as show every value, the others with ``-m long``.

``@pytest.mark.thinned`` keeps cases until every value of every parameter is among them; ``@pytest.mark.thinned(2)`` until
every pair of values of two parameters is. What is kept depends on nothing but the parameters.
"""

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import pytest

Group = tuple[tuple[str, int], ...]
"""Values that occur together: (parameter, number that stands for its value), one or a pair."""


def needed(cases: Sequence[Mapping[str, int]], strength: int) -> list[int]:
    """Which cases it takes.

    Args:
        cases: for each case a number that stands for the value of each parameter.
        strength: 1: every value; 2: every pair of values that occurs.

    Returns:
        Indices of the cases, ascending.
    """
    groups: list[set[Group]] = [
        set(itertools.combinations(sorted(case.items()), min(strength, len(case)))) for case in cases
    ]
    missing = set().union(*groups)
    kept: list[int] = []
    uses: Counter[Group] = Counter()
    while missing:
        # The case that shows most; of several, the one whose values were shown least; of these, the first.
        best = max(
            range(len(cases)), key=lambda k: (len(groups[k] & missing), -sum(uses[(v,)] for v in cases[k].items()))
        )
        kept.append(best)
        missing -= groups[best]
        uses.update((value,) for value in cases[best].items())
    return sorted(kept)


def mark_long_what_is_not_needed(items: Iterable[pytest.Item]) -> None:
    """Give the marker ``long`` to what the quick run leaves out."""
    families: dict[str, list[pytest.Function]] = {}
    for item in items:
        if isinstance(item, pytest.Function) and item.get_closest_marker("thinned") and hasattr(item, "callspec"):
            families.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for family in families.values():
        marker = family[0].get_closest_marker("thinned")
        assert marker is not None
        # The cases share the objects of the lists of values.
        cases = [{name: id(value) for name, value in item.callspec.params.items()} for item in family]
        kept = needed(cases, *(marker.args or (1,)))
        for k, item in enumerate(family):
            if k not in kept:
                item.add_marker(pytest.mark.long)
