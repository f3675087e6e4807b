"""ArduCopter's SmartRTL on the mock vehicle: the flown path, simplified and with its loops cut out, and back along it.

As libraries/AP_SmartRTL and mode_smart_rtl.cpp of ArduCopter 4.7, where they decide the path; the prediction in
``uavcover/missions/failsafe_path.py`` shares no code with it.
"""

import math
from collections.abc import Sequence

import numpy as np

from uavcover.mock.dynamics import Vector
from uavcover.mock.tuning import FLIGHT

SMART_RTL = 21
"""Its flight mode number."""


class Trail:
    """The positions that SmartRTL flies back to.

    Attributes:
        is_active: whether SmartRTL is available.
    """

    def __init__(self) -> None:
        self._points: list[Vector] = []
        self._accuracy_m, self._most, self._simplified = 2.0, 300, 0
        self._good_s = self._saved_s = 0.0
        self.is_active = False

    def begin(self, here: Vector | None, now: float, *, accuracy_m: float, most: float) -> None:
        """Forget the path and begin at ``here``, as at arming; without a position or a buffer there is no SmartRTL."""
        self._accuracy_m, self._most = accuracy_m, int(min(500.0, most))
        self._points, self._simplified = [], 0
        self._good_s = self._saved_s = now
        self.is_active = here is not None and self._most > 0 and accuracy_m > 0.0
        if here is not None and self.is_active:
            self._points.append(here)

    def note(self, here: Vector | None, now: float) -> str | None:
        """Add a position, none where it is lost; why SmartRTL ends with it, in the autopilot's words."""
        if not self.is_active:
            return None
        if here is None:
            return self._end("bad position") if now - self._good_s > FLIGHT.trail_timeout_s else None
        self._good_s = now
        if math.dist(self._points[-1], here) < self._accuracy_m:
            self._saved_s = now
            return None
        if len(self._points) < self._most:
            self._points.append(here)
            self._saved_s = now
        new, is_low = len(self._points) - self._simplified, self._most - len(self._points) <= FLIGHT.low_space
        if new >= FLIGHT.routine_points or (is_low and new >= FLIGHT.low_space):
            self._simplify()
        elif is_low:
            self._prune()
        return self._end("buffer full") if now - self._saved_s > FLIGHT.trail_timeout_s else None

    def pop_near(self, here: Vector) -> None:
        """Forget the newest position once it is reached on the way back."""
        if len(self._points) > 1 and math.dist(self._points[-1], here) <= self._accuracy_m:
            self._points.pop()

    def back(self) -> list[Vector]:
        """The cleaned path, newest first; its last point is where the vehicle was armed."""
        self._simplify()
        self._prune()
        return self._points[::-1]

    def _end(self, why: str) -> str:
        self.is_active = False
        return f"SmartRTL deactivated: {why}"

    def _simplify(self) -> None:
        """Ramer-Douglas-Peucker on what was added since the last time."""
        first = max(0, self._simplified - 1)
        self._points[first:] = _simplified(self._points[first:], FLIGHT.simplify_share * self._accuracy_m)
        self._simplified = len(self._points)

    def _prune(self) -> None:
        """Cut out loops between segments that approach each other; of overlapping loops the longer one."""
        points, loops = self._points, list[tuple[float, int, int, Vector]]()
        for i in range(len(points) - 1, 3, -1):
            for j in range(1, i - 1):
                found = _nearest(points[i], points[i - 1], points[j - 1], points[j])
                if found is None or found[0] >= FLIGHT.prune_share * self._accuracy_m:
                    continue
                middle = found[1]
                length = sum(math.dist(a, b) ** 2 for a, b in zip(points[j : i - 1], points[j + 1 : i], strict=True))
                length += math.dist(middle, points[j]) ** 2 + math.dist(middle, points[i - 1]) ** 2
                rivals = [one for one in loops if one[1] <= i - 1 and j <= one[2]]
                if sum(one[0] for one in rivals) <= length:
                    loops = [one for one in loops if one not in rivals] + [(length, j, i - 1, middle)]
                break
        for _, start, end, middle in sorted(loops, key=lambda one: -one[1]):
            points[start : end + 1] = [middle]
        self._simplified = min(self._simplified, len(points))


def _simplified(points: Sequence[Vector], epsilon_m: float) -> list[Vector]:
    kept, stack = {0, len(points) - 1}, [(0, len(points) - 1)]
    line = np.asarray(points, float)
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        way, inner = line[b] - line[a], line[a + 1 : b] - line[a]
        length = float(way @ way)
        share = np.clip(inner @ way / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(inner))
        off = np.linalg.norm(inner - share[:, None] * way, axis=1)
        worst = a + 1 + int(off.argmax())
        if off.max() > epsilon_m:
            kept.add(worst)
            stack += [(a, worst), (worst, b)]
    return [points[k] for k in sorted(kept)]


def _nearest(a: Vector, b: Vector, c: Vector, d: Vector) -> tuple[float, Vector] | None:
    """Distance and middle of two segments where they are nearest; None of parallel ones, as the autopilot has it."""
    one, two, apart = (tuple(q - p for p, q in zip(x, y, strict=True)) for x, y in ((a, b), (c, d), (c, a)))
    aa, ab, bb = _dot(one, one), _dot(one, two), _dot(two, two)
    da, db = _dot(one, apart), _dot(two, apart)
    if abs(aa * bb - ab * ab) < 1e-6:
        return None
    t = max(0.0, min(1.0, (ab * db - bb * da) / (aa * bb - ab * ab)))
    u = max(0.0, min(1.0, (aa * db - ab * da) / (aa * bb - ab * ab)))
    first = tuple(p + t * q for p, q in zip(a, one, strict=True))
    second = tuple(p + u * q for p, q in zip(c, two, strict=True))
    x, y, z = (0.5 * (p + q) for p, q in zip(first, second, strict=True))
    return math.dist(first, second), (x, y, z)


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))
