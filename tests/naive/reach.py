import math


def farthest_looks(centres, tops, east0, north0, side, tan_half_fov, reach):
    """Each cell against each square, the distances by its four corners and the nearest place of it."""
    out = []
    for e, n, u in centres:
        best = 0.0
        for i, row in enumerate(tops):
            for j, top in enumerate(row):
                west, south = east0 + j * side, north0 + i * side
                near = math.dist((e, n), (min(max(e, west), west + side), min(max(n, south), south + side)))
                far = max(math.dist((e, n), (x, y)) for x in (west, west + side) for y in (south, south + side))
                radius = min(reach, tan_half_fov * (top - u)) if math.isfinite(top) else -1.0
                if near <= radius:
                    best = max(best, min(radius, far))
        out.append(best)
    return out
