"""What the latest routes see is kept, and never mistaken for what another one sees."""

import numpy as np
import pytest

from uavcover.sensing.coverage_map import RecentlyObserved


def test_a_route_is_judged_once_and_another_one_by_itself() -> None:
    required = []
    recent = RecentlyObserved()
    route, other = np.arange(6.0).reshape(2, 3), np.arange(6.0).reshape(2, 3) + 1e-9

    def observed(number: int) -> np.ndarray:
        required.append(number)
        return np.array([number == 1, True])

    first = recent.get(route, lambda: observed(1))
    assert recent.get(route.copy(), lambda: observed(2)) is first
    assert recent.get(other, lambda: observed(3)).tolist() == [False, True]
    assert required == [1, 3]
    with pytest.raises(ValueError, match="read-only"):
        first[0] = False


def test_the_oldest_routes_are_forgotten_where_memory_ends() -> None:
    required = []
    recent = RecentlyObserved(most_cells=5)

    def get(number: float) -> None:
        def find() -> np.ndarray:
            required.append(number)
            return np.ones(2, dtype=bool)

        recent.get(np.full((1, 3), number), find)

    for number in (1.0, 2.0, 3.0, 2.0, 1.0):
        get(number)
    assert required == [1.0, 2.0, 3.0, 1.0]
