"""The 24 problems of the CEC 2020 suite for multimodal multi-objective optimization, with their reference sets.

Source: Liang, Suganthan, Qu, Gong, Yue, "Problem Definitions and Evaluation Criteria for the CEC 2020 Special Session on
Multimodal Multiobjective Optimization", 2019; where the report and its published code and data disagree, the code and data
are followed (docs/explanation/mmf.md lists each). All problems are minimised and have no constraints but their bounds. Problems
are vectorised functions. Reference sets and fronts are generated; they are equal to the published files (to 2e-13).
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from uavcover.kernels.arrays import FloatArray

Function = Callable[[FloatArray], FloatArray]

_PI: Final = np.pi
_LG2: Final = np.log10(2.0)  # base 10, as the reference data confirm


@dataclass(frozen=True, slots=True, eq=False)
class MmfProblem:
    """One problem of the suite."""

    name: str  # as in the report
    lower: FloatArray  # (n,) lower bounds, read-only
    upper: FloatArray  # (n,) upper bounds, read-only
    n_objectives: int  # m
    hypervolume_reference: FloatArray  # (m,) reference point of the suite
    # whether local Pareto sets belong to the reference (the problems whose names end in ``_l``, ``_l1``...)
    local_sets_wanted: bool
    function: Function  # (k, n) points to (k, m) objectives, without checks

    @property
    def n_variables(self) -> int:
        """Number of variables of the problem."""
        return int(self.lower.size)

    def evaluate(self, x: FloatArray) -> FloatArray:
        """Objectives (k, m) of (k, n) points. Raises ValueError: the points have another number of variables."""
        points = np.asarray(x, dtype=float)
        if points.ndim != 2 or points.shape[1] != self.n_variables:
            raise ValueError(f"{self.name}: points of shape {points.shape}; expected (k, {self.n_variables})")
        return self.function(points)


def _two(f1: FloatArray, f2: FloatArray) -> FloatArray:
    return np.column_stack([f1, f2])


def envelope(t: FloatArray) -> FloatArray:
    """E(t) = exp(-2 log10(2) ((t - 0.1) / 0.8)^2): makes the peaks lower from left to right."""
    return np.asarray(np.exp(-2.0 * _LG2 * ((t - 0.1) / 0.8) ** 2))


def _mmf1(x: FloatArray) -> FloatArray:
    a = np.abs(x[:, 0] - 2.0)
    return _two(a, 1.0 - np.sqrt(a) + 2.0 * (x[:, 1] - np.sin(6.0 * _PI * a + _PI)) ** 2)


def _mmf1_e(x: FloatArray) -> FloatArray:
    a = np.abs(x[:, 0] - 2.0)
    amplitude = np.where(x[:, 0] < 2.0, 1.0, np.exp(x[:, 0]))
    return _two(a, 1.0 - np.sqrt(a) + 2.0 * (x[:, 1] - amplitude * np.sin(6.0 * _PI * a + _PI)) ** 2)


def _mmf2(x: FloatArray) -> FloatArray:
    z = np.where(x[:, 1] <= 1.0, x[:, 1], x[:, 1] - 1.0)
    y = z - np.sqrt(x[:, 0])
    return _two(
        x[:, 0], 1.0 - np.sqrt(x[:, 0]) + 2.0 * (4.0 * y**2 - 2.0 * np.cos(20.0 * _PI * y / np.sqrt(2.0)) + 2.0)
    )


def _mmf4(x: FloatArray) -> FloatArray:
    z = np.where(x[:, 1] <= 1.0, x[:, 1], x[:, 1] - 1.0)
    a = np.abs(x[:, 0])
    return _two(a, 1.0 - x[:, 0] ** 2 + 2.0 * (z - np.sin(_PI * a)) ** 2)


def _mmf5(x: FloatArray) -> FloatArray:
    z = np.where(x[:, 1] <= 1.0, x[:, 1], x[:, 1] - 2.0)
    a = np.abs(x[:, 0] - 2.0)
    return _two(a, 1.0 - np.sqrt(a) + 2.0 * (z - np.sin(6.0 * _PI * a + _PI)) ** 2)


def mmf7_set(a: FloatArray) -> FloatArray:
    """The second variable on the Pareto set of MMF7, as a function of |x1 - 2|."""
    return np.asarray((0.3 * a**2 * np.cos(24.0 * _PI * a + 4.0 * _PI) + 0.6 * a) * np.sin(6.0 * _PI * a + _PI))


def _mmf7(x: FloatArray) -> FloatArray:
    a = np.abs(x[:, 0] - 2.0)
    return _two(a, 1.0 - np.sqrt(a) + (x[:, 1] - mmf7_set(a)) ** 2)


def _mmf8(x: FloatArray) -> FloatArray:
    z = np.where(x[:, 1] <= 4.0, x[:, 1], x[:, 1] - 4.0)
    a = np.abs(x[:, 0])
    s = np.sin(a)
    return _two(s, np.sqrt(np.maximum(0.0, 1.0 - s**2)) + 2.0 * (z - s - a) ** 2)


def _mmf10(x: FloatArray) -> FloatArray:
    g = 2.0 - np.exp(-(((x[:, 1] - 0.2) / 0.004) ** 2)) - 0.8 * np.exp(-(((x[:, 1] - 0.6) / 0.4) ** 2))
    return _two(x[:, 0], g / x[:, 0])


def two_peaks(t: FloatArray) -> FloatArray:
    """The g of MMF11 to MMF13: 2 - E(t) sin^6(2 pi t)."""
    return np.asarray(2.0 - envelope(t) * np.sin(2.0 * _PI * t) ** 6)


def _mmf11(x: FloatArray) -> FloatArray:
    return _two(x[:, 0], two_peaks(x[:, 1]) / x[:, 0])


def _mmf12(x: FloatArray) -> FloatArray:
    g = two_peaks(x[:, 1])
    h = 1.0 - (x[:, 0] / g) ** 2 - (x[:, 0] / g) * np.sin(8.0 * _PI * x[:, 0])
    return _two(x[:, 0], g * h)


def _mmf13(x: FloatArray) -> FloatArray:
    return _two(x[:, 0], two_peaks(x[:, 1] + np.sqrt(x[:, 2])) / x[:, 0])


def _sphere(x: FloatArray, g: FloatArray) -> FloatArray:
    """Points of the octant of radius 1 + g that the angles x1, x2 point at."""
    r = 1.0 + g
    a, b = 0.5 * _PI * x[:, 0], 0.5 * _PI * x[:, 1]
    return np.column_stack([r * np.cos(a) * np.cos(b), r * np.cos(a) * np.sin(b), r * np.sin(a)])


def bent(x: FloatArray) -> FloatArray:
    """The t of the ``_a`` problems: their sheets are bent along x2."""
    return np.asarray(x[:, 2] - 0.5 * np.sin(_PI * x[:, 1]) + 0.25)


def _mmf14(x: FloatArray) -> FloatArray:
    return _sphere(x, 2.0 - np.sin(2.0 * _PI * x[:, 2]) ** 2)


def _mmf14_a(x: FloatArray) -> FloatArray:
    return _sphere(x, 2.0 - np.sin(2.0 * _PI * bent(x)) ** 2)


def _mmf15(x: FloatArray) -> FloatArray:
    return _sphere(x, 2.0 - envelope(x[:, 2]) * np.sin(2.0 * _PI * x[:, 2]) ** 2)


def _mmf15_a(x: FloatArray) -> FloatArray:
    t = bent(x)
    return _sphere(x, 2.0 - envelope(t) * np.sin(2.0 * _PI * t) ** 2)


def _mmf16(n_global: int, n_local: int) -> Function:
    def function(x: FloatArray) -> FloatArray:
        t = x[:, 2]
        left = 2.0 - np.sin(2.0 * n_global * _PI * t) ** 2
        right = 2.0 - envelope(t) * np.sin(2.0 * n_local * _PI * t) ** 2
        return _sphere(x, np.where(t < 0.5, left, right))

    return function


MMF16_SETS: Final = MappingProxyType({"MMF16_l1": (2, 1), "MMF16_l2": (1, 2), "MMF16_l3": (2, 2)})
"""Numbers of global and local Pareto sets of the MMF16 problems."""


def _problem(
    name: str, lower: tuple[float, ...], upper: tuple[float, ...], reference: tuple[float, ...], function: Function
) -> MmfProblem:
    arrays = [np.array(values, dtype=float) for values in (lower, upper, reference)]
    for array in arrays:
        array.flags.writeable = False
    return MmfProblem(
        name=name,
        lower=arrays[0],
        upper=arrays[1],
        n_objectives=len(reference),
        hypervolume_reference=arrays[2],
        local_sets_wanted="_l" in name,
        function=function,
    )


_UNIT2, _UNIT3 = ((0.0, 0.0), (1.0, 1.0)), ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
_TENTH2, _TENTH3 = ((0.1, 0.1), (1.1, 1.1)), ((0.1, 0.1, 0.1), (1.1, 1.1, 1.1))
_R2, _R22, _R25 = (1.1, 1.1), (2.2, 2.2, 2.2), (2.5, 2.5, 2.5)

PROBLEMS: Final = MappingProxyType(
    {
        problem.name: problem
        for problem in (
            _problem("MMF1", (1.0, -1.0), (3.0, 1.0), _R2, _mmf1),
            _problem("MMF2", (0.0, 0.0), (1.0, 2.0), _R2, _mmf2),
            _problem("MMF4", (-1.0, 0.0), (1.0, 2.0), _R2, _mmf4),
            _problem("MMF5", (1.0, -1.0), (3.0, 3.0), _R2, _mmf5),
            _problem("MMF7", (1.0, -1.0), (3.0, 1.0), _R2, _mmf7),
            _problem("MMF8", (-_PI, 0.0), (_PI, 9.0), _R2, _mmf8),
            _problem("MMF10", *_TENTH2, (1.21, 13.2), _mmf10),
            _problem("MMF11", *_TENTH2, (1.21, 15.4), _mmf11),
            _problem("MMF12", *_UNIT2, (1.54, 1.1), _mmf12),
            _problem("MMF13", *_TENTH3, (1.54, 15.4), _mmf13),
            _problem("MMF14", *_UNIT3, _R22, _mmf14),
            _problem("MMF15", *_UNIT3, _R25, _mmf15),
            _problem("MMF1_e", (1.0, -20.0), (3.0, 20.0), _R2, _mmf1_e),
            _problem("MMF14_a", *_UNIT3, _R22, _mmf14_a),
            _problem("MMF15_a", *_UNIT3, _R25, _mmf15_a),
            _problem("MMF10_l", *_TENTH2, (1.21, 13.2), _mmf10),
            _problem("MMF11_l", *_TENTH2, (1.21, 15.4), _mmf11),
            _problem("MMF12_l", *_UNIT2, (1.54, 1.1), _mmf12),
            _problem("MMF13_l", *_TENTH3, (1.54, 15.4), _mmf13),
            _problem("MMF15_l", *_UNIT3, _R25, _mmf15),
            _problem("MMF15_a_l", *_UNIT3, _R25, _mmf15_a),
            *(_problem(name, *_UNIT3, _R25, _mmf16(*sets)) for name, sets in MMF16_SETS.items()),
        )
    }
)
"""The 24 problems by name, in the order of the report."""


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


def _set_of_mmf1() -> FloatArray:
    x1 = np.concatenate([_line(1.0, 2.0, 200), _line(2.0, 3.0, 200)])
    return np.column_stack([x1, np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)])


def _set_of_mmf1_e() -> FloatArray:
    x1 = _line(1.0, 3.0, 400)
    amplitude = np.where(x1 < 2.0, 1.0, np.exp(x1))
    return np.column_stack([x1, amplitude * np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)])


def _set_of_mmf2() -> FloatArray:
    x1 = _line(0.0, 1.0, 200)
    return _both(x1, np.sqrt(x1), 1.0 + np.sqrt(x1))


def _set_of_mmf4() -> FloatArray:
    x1 = _line(-1.0, 1.0, 200)
    s = np.sin(_PI * np.abs(x1))
    return _both(x1, s, s + 1.0)


def _set_of_mmf5() -> FloatArray:
    x1 = _line(1.0, 3.0, 200)
    s = np.sin(6.0 * _PI * np.abs(x1 - 2.0) + _PI)
    return _both(x1, s, s + 2.0)


def _set_of_mmf7() -> FloatArray:
    x1 = _line(1.0, 3.0, 400)
    return np.column_stack([x1, mmf7_set(np.abs(x1 - 2.0))])


def _set_of_mmf8() -> FloatArray:
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


def _set_of_mmf13(*peaks: float) -> Callable[[], FloatArray]:
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


def _set_of_mmf16(n_global: int, n_local: int) -> Callable[[], FloatArray]:
    left = [1.0 / (4 * n_global) + i / (2 * n_global) for i in range(n_global)]
    right = [0.5 + 1.0 / (4 * n_local) + i / (2 * n_local) for i in range(n_local)]
    return _sheets(*left, *right)


_SETS: dict[str, Callable[[], FloatArray]] = {
    "MMF1": _set_of_mmf1,
    "MMF1_e": _set_of_mmf1_e,
    "MMF2": _set_of_mmf2,
    "MMF4": _set_of_mmf4,
    "MMF5": _set_of_mmf5,
    "MMF7": _set_of_mmf7,
    "MMF8": _set_of_mmf8,
    "MMF10": _levels(0.1, 1.1, 0.2),
    "MMF10_l": _levels(0.1, 1.1, 0.2, 0.6),
    "MMF11": _levels(0.1, 1.1, 0.25),
    "MMF11_l": _levels(0.1, 1.1, 0.25, 0.75),
    # The published set stops at 200 of its 208 points; kept for comparability.
    "MMF12": lambda: _falling(0.25)[:200],
    "MMF12_l": lambda: np.vstack([_falling(0.25), _falling(0.75)]),
    "MMF13": _set_of_mmf13(0.75),
    # 75 rows of the second set lie outside of the box; kept for comparability.
    "MMF13_l": _set_of_mmf13(0.75, 1.25),
    "MMF14": _sheets(0.25, 0.75),
    "MMF14_a": _sheets(0.0, 0.5, bent=True),
    "MMF15": _sheets(0.25),
    "MMF15_l": _sheets(0.25, 0.75),
    "MMF15_a": _sheets(0.0, bent=True),
    "MMF15_a_l": _sheets(0.0, 0.5, bent=True),
    **{name: _set_of_mmf16(*sets) for name, sets in MMF16_SETS.items()},
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
