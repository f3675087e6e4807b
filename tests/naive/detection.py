"""Probability of detection by brute force: every look at every cell, the curve read off by hand."""

import math

import numpy as np

from tests.naive.photos import looks


def of_one_look(samples_m, angles_deg, probability, sample_m, off_vertical_deg):
    """Read off a table: between rows, then between columns."""
    if sample_m > samples_m[-1] or off_vertical_deg > angles_deg[-1]:
        return 0.0
    by_angle = [
        float(np.interp(off_vertical_deg, angles_deg, [row[k] for row in probability])) for k in range(len(samples_m))
    ]
    return float(np.interp(sample_m, samples_m, by_angle))


def by_johnson(target_m, pixels_for_half, sample_m):
    """Of observers who notice a target that so many pixels lie across."""
    ratio = target_m / sample_m / pixels_for_half
    odds = math.exp((2.7 + 0.7 * ratio) * math.log(ratio))
    return odds / (1.0 + odds)


def found(sensor, heights_m, eyes, yaws_deg, centres, normals, one_look):
    """Probabilities that each of n cells is found: by the best look, the best from each side, every picture; and in doubt.

    ``one_look(sample_m, off_vertical_deg)`` is the probability of a look.
    """
    taken = [[] for _ in centres]
    doubtful = np.zeros(len(centres), bool)
    for number, cells, samples, unclear in looks(sensor, heights_m, eyes, yaws_deg, centres, normals):
        doubtful |= unclear
        for cell, sample in zip(cells, samples, strict=True):
            taken[cell].append((number, sample))
    best, by_sides, by_photos = (np.zeros(len(centres)) for _ in range(3))
    for cell, observed in enumerate(taken):
        sides, missed = {}, 1.0
        for number, sample_m in observed:
            away = eyes[number] - centres[cell]
            off_vertical = math.degrees(math.acos(away[2] / math.dist(eyes[number], centres[cell])))
            fraction = one_look(sample_m, off_vertical)
            missed *= 1.0 - fraction
            bearing = math.degrees(math.atan2(away[0], away[1])) % 360.0
            quarter = ("N", "E", "S", "W", "N")[int((bearing + 45.0) // 90.0)]
            side = "above" if off_vertical <= 45.0 else quarter
            doubtful[cell] |= abs(off_vertical - 45.0) < 1e-6 or abs((bearing + 45.0) % 90.0) < 1e-6
            sides.setdefault(side, []).append(fraction)
        best[cell] = max((max(side) for side in sides.values()), default=0.0)
        by_sides[cell] = 1.0 - math.prod(1.0 - max(side) for side in sides.values())
        by_photos[cell] = 1.0 - missed
    return best, by_sides, by_photos, doubtful
