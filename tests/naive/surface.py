"""The bilinear surface, its slopes and the height of a segment above it, in exact fractions."""

import itertools
import math
from fractions import Fraction


def _place(nodes, east0, north0, step, east, north):
    """Row and column of the cell, and where in it; None outside."""
    u = (Fraction(east) - Fraction(east0)) / Fraction(step)
    v = (Fraction(north) - Fraction(north0)) / Fraction(step)
    rows, columns = len(nodes), len(nodes[0])
    if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
        return None
    i, j = min(math.floor(v), rows - 2), min(math.floor(u), columns - 2)
    return i, j, u - j, v - i


def _bilinear(nodes, i, j, u, v):
    corners = [nodes[i][j], nodes[i][j + 1], nodes[i + 1][j], nodes[i + 1][j + 1]]
    if any(math.isnan(z) for z in corners):
        return None
    sw, se, nw, ne = (Fraction(float(z)) for z in corners)
    return (1 - u) * (1 - v) * sw + u * (1 - v) * se + (1 - u) * v * nw + u * v * ne


def height(nodes, east0, north0, step, east, north):
    place = _place(nodes, east0, north0, step, east, north)
    z = None if place is None else _bilinear(nodes, *place)
    return math.nan if z is None else float(z)


def gradient(nodes, east0, north0, step, east, north):
    place = _place(nodes, east0, north0, step, east, north)
    if place is None or _bilinear(nodes, *place) is None:
        return math.nan, math.nan
    i, j, u, v = place
    to_east = _bilinear(nodes, i, j, Fraction(1), v) - _bilinear(nodes, i, j, Fraction(0), v)
    to_north = _bilinear(nodes, i, j, u, Fraction(1)) - _bilinear(nodes, i, j, u, Fraction(0))
    return float(to_east / Fraction(step)), float(to_north / Fraction(step))


def height_range_above(nodes, east0, north0, step, p, q):
    """Smallest and largest height of the segment above the grid: every parabola between two node lines, one by one."""
    if _place(nodes, east0, north0, step, *p[:2]) is None or _place(nodes, east0, north0, step, *q[:2]) is None:
        return math.nan, math.nan
    (u0, v0, z0), (u1, v1, z1) = (
        (
            (Fraction(point[0]) - Fraction(east0)) / Fraction(step),
            (Fraction(point[1]) - Fraction(north0)) / Fraction(step),
            Fraction(point[2]),
        )
        for point in (p, q)
    )
    cuts = {Fraction(0), Fraction(1)}
    for a, b, lines in ((u0, u1, len(nodes[0])), (v0, v1, len(nodes))):
        cuts |= {(line - a) / (b - a) for line in range(lines) if a != b and 0 < (line - a) / (b - a) < 1}
    cuts = sorted(cuts)
    low, high = math.inf, -math.inf
    for start, end in itertools.pairwise(cuts):
        middle = (start + end) / 2
        i = min(math.floor(v0 + middle * (v1 - v0)), len(nodes) - 2)
        j = min(math.floor(u0 + middle * (u1 - u0)), len(nodes[0]) - 2)

        def above(t, i=i, j=j):
            z = _bilinear(nodes, i, j, u0 + t * (u1 - u0) - j, v0 + t * (v1 - v0) - i)
            return None if z is None else z0 + t * (z1 - z0) - z

        if above(middle) is None:
            return math.nan, math.nan
        candidates = [start, end]
        # A quadratic a + b t + c t^2 through three places.
        f0, f1, f2 = above(Fraction(0)), above(Fraction(1)), above(Fraction(2))
        c = (f2 - 2 * f1 + f0) / 2
        if c != 0:
            vertex = -(f1 - f0 - c) / (2 * c)
            candidates += [vertex] if start < vertex < end else []
        values = [above(t) for t in candidates]
        low, high = min(low, *values), max(high, *values)
    return float(low), float(high)


def analytic_height(scale, east, north):
    return scale * math.sin(north / scale) * math.cos(east / scale)


def sampled_heights(height_at, p, q, count):
    """Height above ground at ``count`` + 1 evenly spaced places of the segment."""
    out = []
    for k in range(count + 1):
        t = k / count
        east, north, up = (a + t * (b - a) for a, b in zip(p, q, strict=True))
        out.append(up - height_at(east, north))
    return out
