"""What the latest routes see is kept, and never mistaken for what another one sees."""

import numpy as np
import pytest

from uavcover.sensing.coverage_map import RecentlySeen


def test_a_route_is_judged_once_and_another_one_by_itself() -> None:
    asked = []
    recent = RecentlySeen()
    route, other = np.arange(6.0).reshape(2, 3), np.arange(6.0).reshape(2, 3) + 1e-9

    def seen(number: int) -> np.ndarray:
        asked.append(number)
        return np.array([number == 1, True])

    first = recent.get(route, lambda: seen(1))
    assert recent.get(route.copy(), lambda: seen(2)) is first
    assert recent.get(other, lambda: seen(3)).tolist() == [False, True]
    assert asked == [1, 3]
    with pytest.raises(ValueError, match="read-only"):
        first[0] = False


def test_the_oldest_routes_are_forgotten_where_memory_ends() -> None:
    asked = []
    recent = RecentlySeen(most_cells=5)

    def get(number: float) -> None:
        def find() -> np.ndarray:
            asked.append(number)
            return np.ones(2, dtype=bool)

        recent.get(np.full((1, 3), number), find)

    for number in (1.0, 2.0, 3.0, 2.0, 1.0):
        get(number)
    assert asked == [1.0, 2.0, 3.0, 1.0]
