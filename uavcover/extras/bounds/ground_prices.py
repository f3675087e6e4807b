"""Upper bounds on the price of ground that a move newly observes: the proof for whole squares of places.

docs/explanation/bounds.md has the reasoning. As a place moves, ground passes the ends of what is observed along each direction
(``relief.py``); half of what passes in either sense, times its price, is the rate. It is bounded for all places of a square of
the lattice together, for all directions of a bin, and for all headings.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.extras.bounds.relief import EXACT_M, LEAST_GROWTH, Relief, farthest_observed, height
from uavcover.kernels.jit import allocating_kernel, kernel

E_LOW, E_HIGH, N_LOW, N_HIGH, HIGHEST, PE_LOW, PE_HIGH, PN_LOW, PN_HIGH = range(9)
"""What is known of a window of squares: slopes of the ground towards east and north, the highest price, and slopes of the price
towards both, as if all of it were priced."""
WINDOW_FIELDS = 9
WORTH, BY_E, BY_N, MOST, BENT, LEAST_R, MOST_R = range(7)
"""Of the end of view in a bin of directions: what it is worth at most from the middle of the square; what it grows by towards
the square's eastern and northern sides; what it is worth anywhere; what is gained where changes, and how much a direction
counts, grow to the same side of the bin; the smallest and the largest distance."""
PASSED_FIELDS = 7


class NodePrices(NamedTuple):
    """Prices of ground on the squares of a relief.

    Attributes:
        per_m2: (rows + 1, columns + 1) at the nodes, bilinear between them where a square is priced.
        windows: (rows, columns, WINDOW_FIELDS) of the squares from each on towards north-east.
        around: half the width of what a window covers for certain, metres.
        slack: part of it that is for changes of distance.
    """

    per_m2: NDArray[np.float64]
    windows: NDArray[np.float64]
    around: float
    slack: float


@kernel
def _along(ue: float, un: float, box: NDArray[np.float64], first: int) -> tuple[float, float]:
    """Smallest and largest product of a direction and a vector of a box: four numbers from ``first`` on."""
    e0, e1, n0, n1 = box[first], box[first + 1], box[first + 2], box[first + 3]
    low = (ue * e0 if ue > 0.0 else ue * e1) + (un * n0 if un > 0.0 else un * n1)
    high = (ue * e1 if ue > 0.0 else ue * e0) + (un * n1 if un > 0.0 else un * n0)
    return low, high


@kernel
def _steepest(box: NDArray[np.float64], first: int) -> float:
    return float(max(abs(box[first]), abs(box[first + 1])) + max(abs(box[first + 2]), abs(box[first + 3])))


@kernel
def _look_around(
    prices: NodePrices, side: float, e: float, n: float, ue: float, un: float, first: float, last: float,
    box: NDArray[np.float64],
) -> None:  # fmt: skip
    """Write to ``box`` what windows between two distances from a place say together."""
    box[E_LOW], box[N_LOW], box[PE_LOW], box[PN_LOW] = math.inf, math.inf, math.inf, math.inf
    box[E_HIGH], box[N_HIGH], box[PE_HIGH], box[PN_HIGH], box[HIGHEST] = (
        -math.inf,
        -math.inf,
        -math.inf,
        -math.inf,
        0.0,
    )
    at = min(first + prices.slack, max(last - prices.slack, first))
    while True:
        window = prices.windows[
            int((n + at * un - prices.around) / side), int((e + at * ue - prices.around) / side)
        ]  # fmt: skip
        for f in (E_LOW, N_LOW, PE_LOW, PN_LOW):
            box[f] = min(box[f], window[f])
        for f in (E_HIGH, N_HIGH, PE_HIGH, PN_HIGH, HIGHEST):
            box[f] = max(box[f], window[f])
        if at + prices.slack >= last - 1e-9:
            return
        at = min(at + 2.0 * prices.slack, last - prices.slack)


@kernel
def _quotients(low: float, high: float, least: float, most: float) -> tuple[float, float]:
    """The smallest and the largest quotient of a number between two and a positive one between two."""
    return (low / least if low < 0.0 else low / most), (high / least if high > 0.0 else high / most)


@kernel
def _products(a0: float, a1: float, b0: float, b1: float) -> tuple[float, float]:
    """The smallest and the largest product of two numbers, each between two."""
    p, q, r, s = a0 * b0, a0 * b1, a1 * b0, a1 * b1
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@kernel
def _passed(
    relief: Relief, prices: NodePrices, position: tuple[float, float], direction: tuple[float, float], r: float, wide: float,
    slopes: NDArray[np.float64], box: NDArray[np.float64], out: NDArray[np.float64],
) -> None:  # fmt: skip
    """Price times distance over growth at the end of view in a bin of directions, for all places of a square.

    Where a price, a distance or the growth changes with the place or with the direction, the change in the middle of what is
    possible is kept with its sign: over the whole circle such changes nearly cancel. The rest is added.

    Args:
        relief: heights.
        prices: of the ground.
        position: the middle of the square, metres east and north of the first node.
        direction: the middle of the bin.
        r: how far ground is observed there.
        wide: of the bin, radians.
        slopes: (2, 2) of the top in both triangles of the square.
        box: (WINDOW_FIELDS,) is written.
        out: (PASSED_FIELDS,) is written. WORTH is 0 where nothing there is priced.
    """
    ue, un = direction
    tangent, reach, half, h = relief.tangent, relief.reach, 0.5 * wide, 0.5 * relief.side
    aside, growth, fastest, off, least, most = prices.slack, 1.0, 1.0, 0.0, 0.0, 0.0
    re0, re1, rn0, rn1 = 0.0, 0.0, 0.0, 0.0
    first, last = r, r
    # How much further than the reach the cone observes there, times its growth.
    ends, spare = tangent == 0.0, 0.0
    if not ends and r >= reach:
        top, _, _ = height(relief, relief.top_m, position[0], position[1])
        up, _, _ = height(relief, relief.ground_m, position[0] + reach * ue, position[1] + reach * un)
        spare = tangent * (top - up) - reach
    while True:
        first, last = max(r - aside, 0.0), min(r + aside, reach)
        _look_around(prices, relief.side, position[0], position[1], ue, un, first, last, box)
        if tangent == 0.0:
            break
        steep = half * _steepest(box, E_LOW)
        low, high = _along(ue, un, box, E_LOW)
        growth = max(1.0 + tangent * (low - steep), LEAST_GROWTH)
        fastest = max(1.0 + tangent * (high + steep), growth)
        # With the place, distance changes at between these rates,
        low, high = min(slopes[0, 0], slopes[1, 0]) - box[E_HIGH], max(slopes[0, 0], slopes[1, 0]) - box[E_LOW]
        spared = h * max(abs(low), abs(high))
        re0, re1 = _quotients(tangent * low, tangent * high, growth, fastest)
        low, high = min(slopes[0, 1], slopes[1, 1]) - box[N_HIGH], max(slopes[0, 1], slopes[1, 1]) - box[N_LOW]
        spared += h * max(abs(low), abs(high))
        rn0, rn1 = _quotients(tangent * low, tangent * high, growth, fastest)
        off = h * (max(abs(re0), abs(re1)) + max(abs(rn0), abs(rn1))) + 2.0 * EXACT_M
        # and with the direction at between these.
        low, high = _along(un, -ue, box, E_LOW)
        low, high = low - steep, high + steep
        if spare > tangent * (spared + half * reach * max(abs(low), abs(high))) + EXACT_M:
            # No place and no direction has less to spare than that.
            ends = True
            break
        low, high = _quotients(tangent * low, tangent * high, growth, fastest)
        least, most = min(low * first, low * last), max(high * first, high * last)
        if off + half * max(abs(least), abs(most)) <= aside or (first == 0.0 and last == reach):
            break
        aside = max(1.2 * aside, 1.02 * (off + half * max(abs(least), abs(most))))
    if ends:
        off, least, most, r = 0.0, 0.0, 0.0, reach
    moved = off + half * max(abs(least), abs(most))
    out[LEAST_R], out[MOST_R] = r - moved, r + moved
    price = box[HIGHEST]
    out[WORTH] = 0.0
    if not price > 0.0:
        return
    if ends:
        re0, re1, rn0, rn1, growth = 0.0, 0.0, 0.0, 0.0, 1.0
    least_growth = growth
    # Growth within the bin: what it is at least in the middle, and what changes to the one side and to the other.
    turning = 0.0
    if not ends:
        low, high = _along(ue, un, box, E_LOW)
        c0, c1 = _along(-un, ue, box, E_LOW)
        turning = 0.5 * tangent * abs(c0 + c1)
        level = 1.0 + tangent * (low - 0.5 * half * (c1 - c0) - half * half * _steepest(box, E_LOW))
        if level - half * turning > growth:
            growth = level
        else:
            turning = 0.0
    turning /= growth
    pe, pn, ps, pv = 0.0, 0.0, 0.0, 0.0
    # The price here as if all ground around were priced, and how it changes with the place and with the direction.
    e, n = (position[0] + r * ue) / relief.side, (position[1] + r * un) / relief.side
    j, i = int(e), int(n)
    e, n = e - j, n - i
    p = prices.per_m2
    here = (1.0 - n) * ((1.0 - e) * p[i, j] + e * p[i, j + 1]) + n * ((1.0 - e) * p[i + 1, j] + e * p[i + 1, j + 1])
    steep = half * _steepest(box, PE_LOW)
    q0, q1 = _along(ue, un, box, PE_LOW)
    q0, q1 = q0 - steep, q1 + steep
    low, high = _products(q0, q1, re0, re1)
    e0, e1 = box[PE_LOW] + low, box[PE_HIGH] + high
    low, high = _products(q0, q1, rn0, rn1)
    n0, n1 = box[PN_LOW] + low, box[PN_HIGH] + high
    c0, c1 = _along(-un, ue, box, PE_LOW)
    far, near = min(r + moved, reach), max(r - moved, 0.0)
    c0, c1 = c0 - steep, c1 + steep
    c0, c1 = min(c0 * near, c0 * far), max(c1 * near, c1 * far)
    low, high = _products(q0, q1, least, most)
    s0, s1 = c0 + low, c1 + high
    here += 0.5 * h * (e1 - e0 + n1 - n0) + _steepest(box, PE_LOW) * 2.0 * EXACT_M
    if here + 0.25 * half * (s1 - s0) < price:
        price, pe, pn, ps, pv = here, 0.5 * (e0 + e1), 0.5 * (n0 + n1), 0.5 * (s0 + s1), 0.5 * (s1 - s0)
    r += 0.5 * h * (re1 - re0 + rn1 - rn0) + (0.0 if ends else 2.0 * EXACT_M)
    be, bn, bs, bv = 0.5 * (re0 + re1), 0.5 * (rn0 + rn1), 0.5 * (least + most), 0.5 * (most - least)
    second = (h * (abs(pe) + abs(pn)) + half * (abs(ps) + pv)) * (h * (abs(be) + abs(bn)) + half * (abs(bs) + bv))
    askew = price * bv + r * pv
    odd, bend = abs(price * bs + r * ps), half * turning
    # 1 / (1 + z) <= 1 - z + z^2 / (1 - |z|)
    more = bend * bend / (1.0 - bend)
    out[WORTH] = (
        (price * r + second + 0.5 * half * askew) * (1.0 + more) + half * (odd + askew) * (bend + more)
    ) / growth
    out[BY_E] = (price * be + r * pe) * h / growth
    out[BY_N] = (price * bn + r * pn) * h / growth
    out[MOST] = box[HIGHEST] * reach / least_growth
    shifted = h * (abs(price * be + r * pe) + abs(price * bn + r * pn))
    out[WORTH] += shifted * more / growth
    out[BENT] = half * (half * (odd + askew) + (price * r + shifted + second) * bend) / growth


@allocating_kernel
def rates_in_squares(
    relief: Relief, prices: NodePrices, directions: NDArray[np.float64], group: int, headings: NDArray[np.float64], stride: int,
    offset: tuple[int, int], parts: int, rates: NDArray[np.float64], largest: NDArray[np.float64],
) -> None:  # fmt: skip
    """Write what a metre of path gains at most at any place of each square, along any heading.

    Args:
        relief: heights; nothing within ``reach`` and a few squares of its edges is allowed.
        prices: of the ground.
        directions: (bins, 2) middles of equal bins all around.
        group: bins that are added up before headings are looked at; a divisor of their number.
        headings: (m, 2) unit vectors, evenly over half a turn.
        stride: 1 for a proof; otherwise only every n-th row and column of squares is looked at.
        offset: of these, rows and columns less than ``stride``.
        parts: squares along the side of a cell.
        rates: (rows, columns) is written where looked at.
        largest: (rows // parts, columns // parts) the largest rate of the places to whose gain the ground of each cell may add,
            is written where it is larger.
    """
    bins, side, tangent, reach = len(directions), relief.side, relief.tangent, relief.reach
    wide = 2.0 * math.pi / bins
    chord = 2.0 * math.sin(0.5 * wide)
    groups = bins // group
    sums_of, corner, sums = np.empty((3, groups, 5)), np.empty((groups, 5)), np.empty(len(headings))
    unsure, slopes, box = np.empty((bins, 4)), np.empty((2, 2)), np.empty(WINDOW_FIELDS)
    passed = np.empty((bins, PASSED_FIELDS))
    far = stride * (int((reach / side + 4.0) / stride) + 1)
    rows, columns = relief.allowed.shape
    size = parts * side
    for i in range(far + offset[0], rows - far, stride):
        for j in range(far + offset[1], columns - far, stride):
            rates[i, j] = 0.0
            if not relief.allowed[i, j]:
                continue
            position = ((j + 0.5) * side, (i + 0.5) * side)
            top, _, _ = height(relief, relief.top_m, position[0], position[1])
            sw, se = relief.top_m[i, j], relief.top_m[i, j + 1]
            nw, ne = relief.top_m[i + 1, j], relief.top_m[i + 1, j + 1]
            slopes[0, 0], slopes[0, 1] = (se - sw) / side, (ne - se) / side
            slopes[1, 0], slopes[1, 1] = (ne - nw) / side, (nw - sw) / side
            sums_of[:] = 0.0
            count, highest, aslant, r = 0, 0.0, 0.0, 0.5 * reach
            for k in range(bins):
                ue, un = directions[k, 0], directions[k, 1]
                r = farthest_observed(relief, position[0], position[1], top, ue, un, r)
                out = passed[k]
                _passed(relief, prices, position, (ue, un), r, wide, slopes, box, out)
                if not out[WORTH] > 0.0:
                    continue
                aslant += wide * out[BENT]
                g = k // group
                if tangent == 0.0 or out[LEAST_R] >= reach - 2.0 * EXACT_M:
                    for a in range(3):
                        sums_of[a, g, 3] += out[a] * chord * ue
                        sums_of[a, g, 4] += out[a] * chord * un
                    highest = max(highest, out[WORTH] + abs(out[BY_E]) + abs(out[BY_N]))
                elif out[MOST_R] >= reach:
                    unsure[count, 0], unsure[count, 1], unsure[count, 2], unsure[count, 3] = (
                        out[MOST],
                        box[HIGHEST] * reach,
                        ue,
                        un,
                    )
                    count += 1
                    highest = max(highest, max(out[MOST], box[HIGHEST] * reach))
                else:
                    for a in range(3):
                        sums_of[a, g, 0] += out[a] * chord * ue
                        sums_of[a, g, 1] += out[a] * chord * un
                        sums_of[a, g, 2] += out[a] * wide * tangent
                    highest = max(highest, out[WORTH] + abs(out[BY_E]) + abs(out[BY_N]))
            if not highest > 0.0:
                continue
            most = 0.0
            for c in range(4):
                east, north = (1.0 if c % 2 else -1.0), (1.0 if c // 2 else -1.0)
                for g in range(groups):
                    for f in range(5):
                        corner[g, f] = sums_of[0, g, f] + east * sums_of[1, g, f] + north * sums_of[2, g, f]
                for s in range(2):
                    most = max(most, _largest_sum(corner, unsure[:count], headings, slopes[s], tangent, wide, sums))
            rates[i, j] = 0.5 * most / math.cos(0.5 * math.pi / len(headings)) + 0.5 * (
                highest * (group * wide) ** 2 + aslant * (1.0 + tangent * np.abs(slopes).sum())
            )
            _tell_ground(prices, position, directions, reach, size, passed, rates[i, j], largest)


@kernel
def _tell_ground(
    prices: NodePrices, position: tuple[float, float], directions: NDArray[np.float64], reach: float, size: float,
    passed: NDArray[np.float64], rate: float, largest: NDArray[np.float64],
) -> None:  # fmt: skip
    """Write a rate to all cells whose ground may be at the end of view from a square: the windows that its bound looked at."""
    for k in range(len(directions)):
        if not passed[k, WORTH] > 0.0:
            continue
        first, last = max(passed[k, LEAST_R], 0.0), min(passed[k, MOST_R], reach)
        at = min(first + prices.slack, max(last - prices.slack, first))
        while True:
            e, n = position[0] + at * directions[k, 0], position[1] + at * directions[k, 1]
            for i in range(int((n - prices.around) / size), int((n + prices.around) / size) + 1):
                for j in range(int((e - prices.around) / size), int((e + prices.around) / size) + 1):
                    largest[i, j] = max(largest[i, j], rate)
            if at + prices.slack >= last - 1e-9:
                break
            at = min(at + 2.0 * prices.slack, last - prices.slack)


@allocating_kernel
def _largest_sum(
    parts: NDArray[np.float64], unsure: NDArray[np.float64], headings: NDArray[np.float64], slope: NDArray[np.float64],
    tangent: float, wide: float, sums: NDArray[np.float64],
) -> float:  # fmt: skip
    """Largest sum over the headings of what passes the end of view in both senses."""
    for m in range(len(headings)):
        he, hn = headings[m, 0], headings[m, 1]
        sums[m] = 0.0
        for b in range(len(unsure)):
            flat = he * unsure[b, 2] + hn * unsure[b, 3]
            lifted = flat + tangent * (he * slope[0] + hn * slope[1])
            # Within the bin each changes by no more than half its width.
            sums[m] += wide * max(unsure[b, 0] * (abs(lifted) + 0.5 * wide), unsure[b, 1] * (abs(flat) + 0.5 * wide))
    for g in range(len(parts)):
        ve, vn = parts[g, 0] + parts[g, 2] * slope[0], parts[g, 1] + parts[g, 2] * slope[1]
        if ve != 0.0 or vn != 0.0:
            for m in range(len(headings)):
                sums[m] += abs(headings[m, 0] * ve + headings[m, 1] * vn)
        ve, vn = parts[g, 3], parts[g, 4]
        if ve != 0.0 or vn != 0.0:
            for m in range(len(headings)):
                sums[m] += abs(headings[m, 0] * ve + headings[m, 1] * vn)
    return float(sums.max())
