"""Reference Pareto sets and fronts of the MMF suite, generated; equal to the published files (to 2e-13)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uavcover.extras.benchmarks.mmf.problems import MMF16_SETS, PROBLEMS, mmf7_set, two_peaks
from uavcover.kernels.arrays import FloatArray

_PI = np.pi


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSets:
    """The reference of a problem; read-only. Rows of both have the same count, but need not be images of one another."""

    pareto_set: FloatArray  # (r, n) points in decision space
    pareto_front: FloatArray  # (r, m) points in objective space


def reference_sets(name: str) -> ReferenceSets:
    """The reference sets of a problem by its name. Raises KeyError: no such problem."""
    problem = PROBLEMS[name]
    points = _SETS[name]()
    front = _FRONTS[name](points) if name in _FRONTS else problem.evaluate(points)
    points.flags.writeable = False
    front.flags.writeable = False
    return ReferenceSets(points, front)


def _line(start: float, end: float, count: int) -> FloatArray:
    return np.linspace(start, end, count)


def _both(x1: FloatArray, *branches: FloatArray) -> FloatArray:
    """Rows (x1, branch) of each branch, one branch after the other."""
    return np.vstack([np.column_stack([x1, branch]) for branch in branches])


def _mmf1() -> FloatArray:
    x1 = np.concatenate([_line(1.0, 2.0, 200), _line(2.0, 3.0, 200)])
    return np.column_stack([x1, np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)])


def _mmf1_e() -> FloatArray:
    x1 = _line(1.0, 3.0, 400)
    amplitude = np.where(x1 < 2.0, 1.0, np.exp(x1))
    return np.column_stack([x1, amplitude * np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)])


def _mmf2() -> FloatArray:
    x1 = _line(0.0, 1.0, 200)
    return _both(x1, np.sqrt(x1), 1.0 + np.sqrt(x1))


def _mmf4() -> FloatArray:
    x1 = _line(-1.0, 1.0, 200)
    s = np.sin(_PI * np.abs(x1))
    return _both(x1, s, s + 1.0)


def _mmf5() -> FloatArray:
    x1 = _line(1.0, 3.0, 200)
    s = np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)
    return _both(x1, s, s + 2.0)


def _mmf7() -> FloatArray:
    x1 = _line(1.0, 3.0, 400)
    return np.column_stack([x1, mmf7_set(np.abs(x1 - 2.0))])


def _mmf8() -> FloatArray:
    x1 = _line(-_PI, _PI, 200)
    s = np.sin(np.abs(x1)) + np.abs(x1)
    return _both(x1, s, s + 4.0)


def _levels(start: float, end: float, *levels: float) -> Callable[[], FloatArray]:
    def points() -> FloatArray:
        x1 = _line(start, end, 200)
        return _both(x1, *(np.full_like(x1, level) for level in levels))

    return points


def _falling(level: float) -> FloatArray:
    """The points at x2 = level of 800 on the line whose second objective is below every one at smaller x1."""
    points = np.column_stack([_line(0.0, 1.0, 800), np.full(800, level)])
    f2 = PROBLEMS["MMF12"].evaluate(points)[:, 1]
    before = np.concatenate([[np.inf], np.minimum.accumulate(f2)[:-1]])
    return points[f2 < before]


def _mmf13(*peaks: float) -> Callable[[], FloatArray]:
    def points() -> FloatArray:
        parts = []
        for peak in peaks:
            x1, x2 = np.meshgrid(_line(0.1, 1.1, 25), _line(0.1, peak - np.sqrt(0.1), 25), indexing="ij")
            parts.append(np.column_stack([x1.ravel(), x2.ravel(), (peak - x2.ravel()) ** 2]))
        return np.vstack(parts)

    return points


def _sheets(*levels: float, bent: bool = False) -> Callable[[], FloatArray]:
    def points() -> FloatArray:
        x1, x2 = (grid.ravel() for grid in np.meshgrid(_line(0.0, 1.0, 25), _line(0.0, 1.0, 25), indexing="ij"))
        base = 0.5 * np.sin(_PI * x2) if bent else np.zeros_like(x2)
        return np.vstack([np.column_stack([x1, x2, base + level]) for level in levels])

    return points


def _mmf16(n_global: int, n_local: int) -> Callable[[], FloatArray]:
    left = [1.0 / (4 * n_global) + i / (2 * n_global) for i in range(n_global)]
    right = [0.5 + 1.0 / (4 * n_local) + i / (2 * n_local) for i in range(n_local)]
    return _sheets(*left, *right)


_SETS: dict[str, Callable[[], FloatArray]] = {
    "MMF1": _mmf1,
    "MMF1_e": _mmf1_e,
    "MMF2": _mmf2,
    "MMF4": _mmf4,
    "MMF5": _mmf5,
    "MMF7": _mmf7,
    "MMF8": _mmf8,
    "MMF10": _levels(0.1, 1.1, 0.2),
    "MMF10_l": _levels(0.1, 1.1, 0.2, 0.6),
    "MMF11": _levels(0.1, 1.1, 0.25),
    "MMF11_l": _levels(0.1, 1.1, 0.25, 0.75),
    # The published set stops at 200 of its 208 points; kept for comparability.
    "MMF12": lambda: _falling(0.25)[:200],
    "MMF12_l": lambda: np.vstack([_falling(0.25), _falling(0.75)]),
    "MMF13": _mmf13(0.75),
    # 75 rows of the second set lie outside of the box; kept for comparability.
    "MMF13_l": _mmf13(0.75, 1.25),
    "MMF14": _sheets(0.25, 0.75),
    "MMF14_a": _sheets(0.0, 0.5, bent=True),
    "MMF15": _sheets(0.25),
    "MMF15_l": _sheets(0.25, 0.75),
    "MMF15_a": _sheets(0.0, bent=True),
    "MMF15_a_l": _sheets(0.0, 0.5, bent=True),
    **{name: _mmf16(*sets) for name, sets in MMF16_SETS.items()},
}


def _root_front(f1: FloatArray) -> FloatArray:
    return np.column_stack([f1, 1.0 - np.sqrt(f1)])


def _twice(f1: FloatArray) -> FloatArray:
    return np.concatenate([f1, f1])


# Fronts that are not the images of the sets.
_FRONTS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "MMF1": lambda _: _root_front(_twice(_line(0.0, 1.0, 200))),
    "MMF2": lambda _: _root_front(_twice(_line(0.0, 1.0, 200))),
    "MMF5": lambda _: _root_front(_line(0.0, 1.0, 400)),
    "MMF7": lambda _: _root_front(_line(0.0, 1.0, 400)),
    "MMF8": lambda _: np.column_stack([_line(0.0, 1.0, 400), np.sqrt(1.0 - _line(0.0, 1.0, 400) ** 2)]),
    "MMF13": lambda _: np.column_stack([_line(0.1, 1.1, 625), two_peaks(np.array([0.75])) / _line(0.1, 1.1, 625)]),
}
