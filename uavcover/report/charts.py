"""Line charts as numbers for SVG; the template draws them, the style sheet colours them."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray

WIDTH, HEIGHT = 760.0, 270.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 14.0, 12.0, 44.0

_MAX_POINTS = 1500
"""Largest number of points of a line: more cannot be distinguished and enlarge the file."""


@dataclass(frozen=True, slots=True)
class Tick:
    """A position on an axis, in picture units, and its label."""

    at: float
    label: str


@dataclass(frozen=True, slots=True)
class Line:
    """A line or a filled outline: its style class, an SVG path, and its name in the legend (empty: not listed)."""

    style: str
    path: str
    name: str = ""


@dataclass(frozen=True, slots=True)
class Mark:
    """A point: its style class, position in the picture, size, and tooltip."""

    style: str
    x: float
    y: float
    radius: float
    title: str


@dataclass(frozen=True, slots=True)
class Key:
    """A style class and its meaning; the style is one of points or of lines."""

    style: str
    name: str
    is_mark: bool


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart ready for drawing.

    Attributes:
        name: identifies it in the page.
        title: above it.
        x_label: below it.
        y_label: beside it.
        x_range: values at the left and right end.
        y_range: values at the bottom and the top.
        x_ticks: on the horizontal axis.
        y_ticks: on the vertical axis.
        lines: in the order of drawing.
        marks: over the lines.
        keys: what the styles mean.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...]
    keys: tuple[Key, ...]


class Plot:
    """Builds a chart: converts values to positions in the picture.

    Args:
        x_range: values at the left and right end; the right one above the left one.
        y_range: values at the bottom and the top, likewise.
    """

    def __init__(self, x_range: tuple[float, float], y_range: tuple[float, float]) -> None:
        self.x_range, self.y_range = _opened(*x_range), _opened(*y_range)
        self._lines: list[Line] = []
        self._marks: list[Mark] = []

    def line(self, style: str, x: FloatArray, y: FloatArray, *, name: str = "") -> None:
        """Add a line through (n,) points, broken where a value is unknown."""
        self._lines.append(Line(style, self._path(*_thinned(x, y)), name))

    def between(self, style: str, x: FloatArray, low: FloatArray, high: FloatArray, *, name: str = "") -> None:
        """Add the region between two lines over the same (n,) positions, where both are known."""
        known = np.isfinite(low) & np.isfinite(high)
        if known.any():
            # Each line is thinned by its own peaks, so the two keep different points.
            below_x, below = _thinned(x[known], low[known])
            above_x, above = _thinned(x[known], high[known])
            path = self._path(np.append(above_x, below_x[::-1]), np.append(above, below[::-1])) + "Z"
            self._lines.append(Line(style, path, name))

    def mark(self, style: str, x: float, y: float, *, radius: float, title: str) -> None:
        """Add a point with a tooltip."""
        self._marks.append(Mark(style, self._x(x), self._y(y), radius, title))

    def finished(self, name: str, title: str, *, x_label: str, y_label: str, mark_keys: Sequence[Key] = ()) -> Chart:
        """The finished chart."""
        keys = [Key(line.style, line.name, is_mark=False) for line in self._lines if line.name]
        return Chart(
            name=name,
            title=title,
            x_label=x_label,
            y_label=y_label,
            x_range=self.x_range,
            y_range=self.y_range,
            x_ticks=tuple(Tick(self._x(v), text) for v, text in nice_ticks(*self.x_range, about=8)),
            y_ticks=tuple(Tick(self._y(v), text) for v, text in nice_ticks(*self.y_range, about=6)),
            lines=tuple(self._lines),
            marks=tuple(self._marks),
            keys=(*keys, *mark_keys),
        )

    def _x(self, value: float) -> float:
        low, high = self.x_range
        return LEFT + (value - low) / (high - low) * (WIDTH - LEFT - RIGHT)

    def _y(self, value: float) -> float:
        low, high = self.y_range
        return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM)

    def _path(self, x: FloatArray, y: FloatArray) -> str:
        parts: list[str] = []
        pen_down = False
        for a, b in zip(x.tolist(), y.tolist(), strict=True):
            known = math.isfinite(a) and math.isfinite(b)
            if known:
                parts.append(f"{'L' if pen_down else 'M'}{self._x(a):.1f} {self._y(b):.1f}")
            pen_down = known
        return "".join(parts)


def nice_ticks(low: float, high: float, *, about: int) -> list[tuple[float, str]]:
    """About ``about`` round values inside a range, with their labels.

    >>> nice_ticks(0.0, 103.0, about=6)
    [(0.0, '0'), (20.0, '20'), (40.0, '40'), (60.0, '60'), (80.0, '80'), (100.0, '100')]
    """
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= rough * (1.0 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    digits += 1 if abs(round(step, digits) - step) > 1e-9 * step else 0
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    # Adding 0.0 turns minus zero into zero.
    return [(i * step + 0.0, f"{i * step + 0.0:.{digits}f}") for i in range(first, last + 1)]


def _opened(low: float, high: float) -> tuple[float, float]:
    """The range, widened if empty."""
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At most about _MAX_POINTS of the points: the ends, minimum and maximum of each stretch, so that no peak is lost."""
    if x.size <= _MAX_POINTS:
        return x, y
    edges = np.linspace(0, x.size, _MAX_POINTS // 2 + 1).astype(int)
    kept = {0, x.size - 1}
    for a, b in itertools.pairwise(edges.tolist()):
        piece = y[a:b]
        if np.isfinite(piece).any():
            kept |= {int(a + np.nanargmin(piece)), int(a + np.nanargmax(piece))}
        if not np.isfinite(piece).all():
            kept.add(int(a + np.argmin(np.isfinite(piece))))
    order = np.array(sorted(kept))
    return x[order], y[order]
