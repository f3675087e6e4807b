"""A vehicle that turns no more tightly than a circle, flown step by step round a corner. Nothing of the package is used."""

import math

import numpy as np

STEP_M = 0.2


def late(u, v, radius_m, back_deg=30.0, reach_m=2000.0):
    """Over the corner at (0, 0) on heading u, then it steers back to the line along v at an angle of ``back_deg`` at most."""
    heading, position, out = math.atan2(u[1], u[0]), np.zeros(2), [np.zeros(2)]
    line = math.atan2(v[1], v[0])
    angle = math.remainder(line - heading, 2.0 * math.pi)
    side = -math.copysign(1.0, angle)  # it comes to lie outside of the turn
    most, turned = STEP_M / radius_m, 0.0
    for _ in range(int(reach_m / STEP_M)):
        off = v[0] * position[1] - v[1] * position[0]  # to the left of the line is positive
        if turned > abs(angle) and off * side <= 0.0:
            break
        left = abs(angle) + math.radians(back_deg) - turned
        step = min(most, left)
        heading += math.copysign(step, angle)
        turned += step
        position = position + STEP_M * np.array([math.cos(heading), math.sin(heading)])
        out.append(position)
    return np.array(out)


def early(u, v, cut_m):
    """From ``cut_m`` before the corner it turns evenly until it heads along v, and is then on that line."""
    angle = math.remainder(math.atan2(v[1], v[0]) - math.atan2(u[1], u[0]), 2.0 * math.pi)
    radius_m = cut_m / math.tan(abs(angle) / 2.0)
    heading, position = math.atan2(u[1], u[0]), -cut_m * np.asarray(u)
    out, left = [position], abs(angle)
    while left > 0.0:
        step = min(STEP_M / radius_m, left)
        heading += math.copysign(step / 2.0, angle)
        position = position + step * radius_m * np.array([math.cos(heading), math.sin(heading)])
        heading += math.copysign(step / 2.0, angle)
        left -= step
        out.append(position)
    return np.array(out)
