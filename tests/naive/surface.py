"""The bilinear surface, its slopes and the height of a segment above it, in exact fractions.

With ``number=float`` the same steps in floating point, thirty times as fast: for who asks only whether a line is clear of the
ground by more than rounding.
"""

import itertools
import math
from fractions import Fraction

EXPONENTS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))


def on_grid(frame, east, north, up, number=Fraction):
    """Column and row, by the definition: down the plumb line to the level, then two polynomials."""
    shrink = 1 - (number(up) - number(frame.level_up_m)) * number(frame.lean_per_m)
    x = (number(east) * shrink - number(frame.east0_m)) / number(frame.scale_m)
    y = (number(north) * shrink - number(frame.north0_m)) / number(frame.scale_m)
    return tuple(
        sum((number(c) * x**i * y**j for c, (i, j) in zip(row.tolist(), EXPONENTS, strict=True) if c != 0.0), number(0))
        for row in frame.terms
    )


def _position(nodes, frame, east, north, up, number=Fraction):
    """Row and column of the cell, and where in it; None outside."""
    u, v = on_grid(frame, east, north, up, number)
    rows, columns = len(nodes), len(nodes[0])
    if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
        return None
    i, j = min(math.floor(v), rows - 2), min(math.floor(u), columns - 2)
    return i, j, u - j, v - i


def _bilinear(nodes, i, j, u, v, number=Fraction):
    corners = [nodes[i][j], nodes[i][j + 1], nodes[i + 1][j], nodes[i + 1][j + 1]]
    if any(math.isnan(z) for z in corners):
        return None
    sw, se, nw, ne = (number(float(z)) for z in corners)
    return (1 - u) * (1 - v) * sw + u * (1 - v) * se + (1 - u) * v * nw + u * v * ne


def height_above(nodes, frame, east, north, up, number=Fraction):
    position = _position(nodes, frame, east, north, up, number)
    z = None if position is None else _bilinear(nodes, *position, number)
    return math.nan if z is None else float(number(up) - z)


def up_above(nodes, frame, east, north, agl, number=Fraction):
    """Halving the interval of all heights until it is nothing."""
    finite = [z for row in nodes for z in row if not math.isnan(z)]
    if not finite:
        return math.nan
    low, high = min(finite) + agl - 1.0, max(finite) + agl + 1.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        above = height_above(nodes, frame, east, north, middle, number)
        if math.isnan(above):
            return math.nan
        low, high = (middle, high) if above < agl else (low, middle)
    return 0.5 * (low + high)


def height(nodes, frame, east, north, number=Fraction):
    return up_above(nodes, frame, east, north, 0.0, number)


def gradient(nodes, frame, east, north):
    """On a square grid."""
    position = _position(nodes, frame, east, north, 0)
    if position is None or _bilinear(nodes, *position) is None:
        return math.nan, math.nan
    i, j, u, v = position
    step = Fraction(frame.scale_m)
    to_east = _bilinear(nodes, i, j, Fraction(1), v) - _bilinear(nodes, i, j, Fraction(0), v)
    to_north = _bilinear(nodes, i, j, u, Fraction(1)) - _bilinear(nodes, i, j, u, Fraction(0))
    return float(to_east / step), float(to_north / step)


def height_range_above(nodes, frame, p, q, number=Fraction):
    """Smallest and largest height of the segment above the grid, in pieces that are straight on it."""
    if not all(math.isfinite(x) for x in (*p, *q)):
        return math.nan, math.nan
    pieces = max(1, math.ceil(math.dist(p, q) / frame.piece_m))
    positions = [[a + k / pieces * (b - a) for a, b in zip(p, q, strict=True)] for k in range(pieces)] + [q]
    ranges = [_range_of_piece(nodes, frame, a, b, number) for a, b in itertools.pairwise(positions)]
    if any(math.isnan(low) for low, _ in ranges):
        return math.nan, math.nan
    return min(low for low, _ in ranges), max(high for _, high in ranges)


def _range_of_piece(nodes, frame, p, q, number):
    """Every parabola between two node lines, one by one."""
    if _position(nodes, frame, *p, number) is None or _position(nodes, frame, *q, number) is None:
        return math.nan, math.nan
    (u0, v0), (u1, v1) = (on_grid(frame, *point, number) for point in (p, q))
    z0, z1 = number(p[2]), number(q[2])
    cuts = {number(0), number(1)}
    for a, b, lines in ((u0, u1, len(nodes[0])), (v0, v1, len(nodes))):
        cuts |= {(line - a) / (b - a) for line in range(lines) if a != b and 0 < (line - a) / (b - a) < 1}
    cuts = sorted(cuts)
    low, high = math.inf, -math.inf
    for start, end in itertools.pairwise(cuts):
        middle = (start + end) / 2
        i = min(math.floor(v0 + middle * (v1 - v0)), len(nodes) - 2)
        j = min(math.floor(u0 + middle * (u1 - u0)), len(nodes[0]) - 2)

        def above(t, i=i, j=j):
            z = _bilinear(nodes, i, j, u0 + t * (u1 - u0) - j, v0 + t * (v1 - v0) - i, number)
            return None if z is None else z0 + t * (z1 - z0) - z

        if above(middle) is None:
            return math.nan, math.nan
        candidates = [start, end]
        # A quadratic a + b t + c t^2 through three places.
        f0, f1, f2 = above(number(0)), above(number(1)), above(number(2))
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
