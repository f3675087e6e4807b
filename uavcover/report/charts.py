"""Line charts as numbers for SVG; the template draws them, the style sheet colours them."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class ChartSize:
    """Size of a chart in its own units, approximately pixels, and the margins around the plot."""

    name: str  # style class; the style sheet shows the frame that fits the screen
    width: float  # of the picture
    height: float  # of the picture
    left: float  # margin for the labels of the vertical axis
    right: float  # margin
    top: float  # margin
    bottom: float  # margin for the labels of the horizontal axis
    x_ticks: int  # about how many ticks the horizontal axis has
    y_ticks: int  # about how many ticks the vertical axis has
    points: int  # largest number of points of a line: more cannot be distinguished and enlarge the file


WIDE = ChartSize("wide", 760.0, 270.0, 62.0, 14.0, 12.0, 44.0, x_ticks=8, y_ticks=6, points=1500)
NARROW = ChartSize("narrow", 330.0, 250.0, 52.0, 10.0, 12.0, 42.0, x_ticks=4, y_ticks=5, points=600)
"""For a phone, with text as large as that of the page."""
PRINTED = ChartSize("print", 720.0, 170.0, 46.0, 6.0, 8.0, 26.0, x_ticks=8, y_ticks=5, points=600)

FRAMES = (WIDE, NARROW)


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
class ChartView:
    """A chart drawn into one frame: ticks on both axes, lines in the order of drawing, marks over them."""

    frame: ChartSize
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart ready for drawing."""

    name: str  # identifies it in the page
    title: str  # above it
    x_label: str  # below it
    y_label: str  # beside it
    x_range: tuple[float, float]  # values at the left and right end
    y_range: tuple[float, float]  # values at the bottom and the top
    pictures: tuple[ChartView, ...]  # the same in each of FRAMES
    keys: tuple[Key, ...]  # what the styles mean

    @property
    def wide(self) -> ChartView:
        """The drawing for a screen."""
        return self.pictures[FRAMES.index(WIDE)]


class Plot:
    """Builds a chart: collects values, and converts them to positions in each frame's picture.

    Args:
        x_range: values at the left and right end; the right one above the left one.
        y_range: values at the bottom and the top; the top one above the bottom one.
    """

    def __init__(self, x_range: tuple[float, float], y_range: tuple[float, float]) -> None:
        self.x_range, self.y_range = _opened(*x_range), _opened(*y_range)
        self._lines: list[Callable[[Scale], Line]] = []
        self._marks: list[Callable[[Scale], Mark]] = []
        self._keys: list[Key] = []

    def line(self, style: str, x: FloatArray, y: FloatArray, *, name: str = "") -> None:
        """Add a line through (n,) points, broken where a value is unknown."""
        self._add(style, name, lambda scale: scale.path(*_thinned(x, y, scale.frame.points)))

    def between(self, style: str, x: FloatArray, low: FloatArray, high: FloatArray, *, name: str = "") -> None:
        """Add the region between two lines over the same (n,) positions, where both are known."""
        known = np.isfinite(low) & np.isfinite(high)

        def path(scale: "Scale") -> str:
            # Each line is thinned by its own peaks, so the two keep different points.
            below_x, below = _thinned(x[known], low[known], scale.frame.points)
            above_x, above = _thinned(x[known], high[known], scale.frame.points)
            return scale.path(np.append(above_x, below_x[::-1]), np.append(above, below[::-1])) + "Z"

        if known.any():
            self._add(style, name, path)

    def mark(self, style: str, x: float, y: float, *, radius: float, title: str) -> None:
        """Add a point with a tooltip."""
        self._marks.append(lambda scale: Mark(style, scale.x(x), scale.y(y), radius, title))

    def finished(self, name: str, title: str, *, x_label: str, y_label: str, mark_keys: Sequence[Key] = ()) -> Chart:
        """The finished chart."""
        return Chart(
            name=name,
            title=title,
            x_label=x_label,
            y_label=y_label,
            x_range=self.x_range,
            y_range=self.y_range,
            pictures=tuple(self._drawn(frame) for frame in FRAMES),
            keys=(*self._keys, *mark_keys),
        )

    def _add(self, style: str, name: str, path: "Callable[[Scale], str]") -> None:
        self._lines.append(lambda scale: Line(style, path(scale), name))
        if name:
            self._keys.append(Key(style, name, is_mark=False))

    def _drawn(self, frame: ChartSize) -> ChartView:
        scale = Scale(frame, self.x_range, self.y_range)
        return ChartView(
            frame=frame,
            x_ticks=tuple(Tick(scale.x(v), text) for v, text in nice_ticks(*self.x_range, about=frame.x_ticks)),
            y_ticks=tuple(Tick(scale.y(v), text) for v, text in nice_ticks(*self.y_range, about=frame.y_ticks)),
            lines=tuple(line(scale) for line in self._lines),
            marks=tuple(mark(scale) for mark in self._marks),
        )


@dataclass(frozen=True, slots=True)
class Scale:
    """Converts values to positions in a frame."""

    frame: ChartSize
    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def x(self, value: float) -> float:
        """Horizontal position of a value."""
        (low, high), frame = self.x_range, self.frame
        return frame.left + (value - low) / (high - low) * (frame.width - frame.left - frame.right)

    def y(self, value: float) -> float:
        """Vertical position of a value."""
        (low, high), frame = self.y_range, self.frame
        fraction = (value - low) / (high - low)
        return frame.height - frame.bottom - fraction * (frame.height - frame.top - frame.bottom)

    def path(self, x: FloatArray, y: FloatArray) -> str:
        """SVG path through (n,) points, broken where a value is unknown."""
        parts: list[str] = []
        pen_down = False
        for a, b in zip(x.tolist(), y.tolist(), strict=True):
            known = math.isfinite(a) and math.isfinite(b)
            if known:
                parts.append(f"{'L' if pen_down else 'M'}{self.x(a):.1f} {self.y(b):.1f}")
            pen_down = known
        return "".join(parts)


def nice_ticks(low: float, high: float, *, about: int) -> list[tuple[float, str]]:
    """Round values inside a range, ``about`` in number, with their labels.

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


def _thinned(x: FloatArray, y: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """At most about ``most`` of the points: ends, minimum and maximum of each stretch, so that no peak is lost."""
    if x.size <= most:
        return x, y
    edges = np.linspace(0, x.size, most // 2 + 1).astype(int)
    kept = {0, x.size - 1}
    for a, b in itertools.pairwise(edges.tolist()):
        piece = y[a:b]
        if np.isfinite(piece).any():
            kept |= {int(a + np.nanargmin(piece)), int(a + np.nanargmax(piece))}
        if not np.isfinite(piece).all():
            kept.add(int(a + np.argmin(np.isfinite(piece))))
    order = np.array(sorted(kept))
    return x[order], y[order]
