"""Slow, obvious judge of whole missions: places along the path, each asked on its own. Nothing of the package is used.

Positions are metres east and north of home on a plane with the ellipsoid's radii there, heights metres above the sea. A row is
(command, frame, (p1, p2, p3, p4), latitude, longitude, height); the first row is number 1, home is 0.
"""

import itertools
import math

import numpy as np

from tests.naive.file_ground import A_M, E2
from tests.naive.turn import early

STEP_M = 2.0
RETURN_EVERY_M, RETURN_STEP_M = 8.0, 4.0


class Plane:
    """Metres around a place."""

    def __init__(self, lat_deg, lon_deg):
        self.lat_deg, self.lon_deg = lat_deg, lon_deg
        s = math.sin(math.radians(lat_deg))
        w = math.sqrt(1.0 - E2 * s * s)
        self.north_m = math.radians(1.0) * A_M * (1.0 - E2) / w**3
        self.east_m = math.radians(1.0) * A_M / w * math.cos(math.radians(lat_deg))

    def to(self, lat_deg, lon_deg):
        return np.array([(lon_deg - self.lon_deg) * self.east_m, (lat_deg - self.lat_deg) * self.north_m])

    def back(self, east, north):
        return self.lat_deg + north / self.north_m, self.lon_deg + east / self.east_m


def order(rows):
    """Numbers in flying order."""
    out, used, at = [], {}, 1
    while at <= len(rows) and len(out) < 5000:
        command, _, params = rows[at - 1][:3]
        if command == 177:
            if used.get(at, 0) < params[1]:
                used[at] = used.get(at, 0) + 1
                at = int(params[0])
                continue
        else:
            out.append(at)
        at += 1
    return out


def path(rows, plane, home_m, return_m, *, px4):
    """[(from, to, phase, (n, 3) east, north, height)] of a multirotor, a place every STEP_M."""

    def position(row, before):
        _, frame, _, lat, lon, alt = row
        en = before[:2] if lat == 0.0 and lon == 0.0 else plane.to(lat, lon)
        if alt == 0.0 and not px4:
            return np.array([*en, before[2]])
        return np.array([*en, alt + (home_m if frame == 3 else 0.0)])

    def line(a, b):
        n = max(2, math.ceil(float(np.linalg.norm(b - a)) / STEP_M) + 1)
        return a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)

    numbers = order(rows)
    parts, at, last, vector = [], np.array([0.0, 0.0, home_m]), 0, None
    for k, number in enumerate(numbers):
        row = rows[number - 1]
        command, params = row[0], row[2]
        if command == 22:
            top = np.array([at[0], at[1], position(row, at)[2]])
            parts.append((last, number, "take-off", line(at, top)))
            at, vector = top, None
        elif command == 16:
            to = position(row, at)
            parts.append((last, number, "route", line(at, to)))
            at, vector = to, (to - at if params[0] == 0.0 else None)
        elif command == 82:
            to = position(row, at)
            v0 = np.zeros(3) if vector is None else vector
            v1 = np.zeros(3)
            follower = next((rows[n - 1] for n in numbers[k + 1 :] if rows[n - 1][0] <= 95), None)
            if follower is not None and follower[1] != 2:
                onward = position(follower, to)
                v1 = onward - (at if follower[0] == 82 else to)
            total, chord = np.linalg.norm(v0) + np.linalg.norm(v1), np.linalg.norm(to - at)
            shrink = min(1.0, 4.0 * chord / total) if total else 1.0
            t = np.linspace(0.0, 1.0, 2 + 3 * math.ceil(chord / STEP_M))[:, None]
            curve = (
                (1.0 + 2.0 * t) * (1.0 - t) ** 2 * at + t * (1.0 - t) ** 2 * v0 * shrink
                + t**2 * (3.0 - 2.0 * t) * to + t**2 * (t - 1.0) * v1 * shrink
            )  # fmt: skip
            parts.append((last, number, "route", curve))
            at, vector = to, (v1 if np.any(v1) else None)
        elif command == 20:
            above = return_above_home(at, home_m, return_m, px4=px4)
            top, over = np.array([at[0], at[1], home_m + above]), np.array([0.0, 0.0, home_m + above])
            parts += [(last, number, "return", line(at, top)), (number, number, "return", line(top, over))]
            parts.append((number, number, "landing", line(over, np.array([0.0, 0.0, home_m]))))
            return parts
        elif command == 21:
            over = np.array([*position(row, at)[:2], at[2]])
            parts.append((last, number, "route", line(at, over)))
            return parts
        else:
            continue
        last = number
    return parts


def return_above_home(at, home_m, return_m, *, px4):
    """Height above home of a return."""
    most = return_m if px4 else min(return_m, max(3.0 * math.hypot(at[0], at[1]), 2.0))
    return max(most, at[2] - home_m)


def inside(east, north, ring):
    """Whether places are inside a ring of (east, north): rays to the east."""
    found = np.zeros(np.shape(east), bool)
    for (x0, y0), (x1, y1) in zip(ring, [*ring[1:], ring[0]], strict=True):
        crosses = (y0 > north) != (y1 > north)
        if y0 != y1:
            found ^= crosses & (east < x0 + (north - y0) * (x1 - x0) / (y1 - y0))
    return found


def from_edge(east, north, ring):
    """Distance of places from the edge of a ring."""
    best = np.full(np.shape(east), np.inf)
    for (x0, y0), (x1, y1) in zip(ring, [*ring[1:], ring[0]], strict=True):
        dx, dy = x1 - x0, y1 - y0
        t = np.clip(((east - x0) * dx + (north - y0) * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        best = np.minimum(best, np.hypot(east - x0 - t * dx, north - y0 - t * dy))
    return best


def judge(rows, home, ground, *, return_m, px4, low_m, high_m, fence=None, zone=None):
    """By how much, in metres, each kind of limit is broken at most, and by which items: {kind: {(from, to): metres}}.

    Negative is by how much it is kept. ``fence`` is a ring of (longitude, latitude), ``zone`` a ring, floor and ceiling above
    the ground; its amount is the largest depth inside where it is entered, and minus the distance otherwise.
    """
    plane = Plane(*home)
    home_m = float(ground.height_m(np.array([home[0]]), np.array([home[1]]))[0])
    local = {name: [tuple(plane.to(lat, lon)) for lon, lat in ring] for name, ring in (("fence", fence or []),)}
    zone_ring = [] if zone is None else [tuple(plane.to(lat, lon)) for lon, lat in zone[0]]
    out = {kind: {} for kind in ("ground", "height", "fence", "no-fly", "return", "return-fence", "return-no-fly")}

    def note(kind, pair, amount):
        out[kind][pair] = max(out[kind].get(pair, -math.inf), float(amount))

    parts = path(rows, plane, home_m, return_m, px4=px4)
    for begin, end, phase, points in [*parts, *(_cut_corners(rows, parts) if px4 else [])]:
        pair = (begin, end)
        east, north, alt = points.T
        above = alt - ground.height_m(*plane.back(east, north))
        if phase in ("route", "return", "turn"):
            note("ground", pair, low_m - above.min())
        if phase in ("route", "take-off"):
            note("height", pair, above.max() - high_m)
        if fence:
            beyond = np.where(inside(east, north, local["fence"]), -1.0, 1.0) * from_edge(east, north, local["fence"])
            note("fence", pair, beyond.max())
        if zone is not None:
            away = from_edge(east, north, zone_ring)
            depth = np.where(
                inside(east, north, zone_ring) & (above > zone[1]) & (above < zone[2]), away, -np.maximum(away, 0.1)
            )
            note("no-fly", pair, depth.max())
        if phase == "route":
            for position in points[:: max(1, round(RETURN_EVERY_M / STEP_M))]:
                height = home_m + return_above_home(position, home_m, return_m, px4=px4)
                t = np.linspace(0.0, 1.0, max(2, math.ceil(math.hypot(position[0], position[1]) / RETURN_STEP_M) + 1))
                return_line = height - ground.height_m(*plane.back(position[0] * (1.0 - t), position[1] * (1.0 - t)))
                note("return", pair, low_m - return_line.min())
                back_e, back_n = position[0] * (1.0 - t), position[1] * (1.0 - t)
                if fence and inside(position[:1], position[1:2], local["fence"])[0]:
                    away = from_edge(back_e, back_n, local["fence"])
                    note("return-fence", pair, np.where(inside(back_e, back_n, local["fence"]), -away, away).max())
                if zone is not None:
                    over = position[2] - ground.height_m(*plane.back(position[:1], position[1:2]))[0]
                    if inside(position[:1], position[1:2], zone_ring)[0] and zone[1] < over < zone[2]:
                        continue
                    # Straight up, straight home, straight down.
                    up_m = np.linspace(over, return_line[0], 40)
                    down_m = np.linspace(0.0, return_line[-1], 40)
                    es = np.concatenate([np.full(40, position[0]), back_e, np.zeros(40)])
                    ns = np.concatenate([np.full(40, position[1]), back_n, np.zeros(40)])
                    hs = np.concatenate([up_m, return_line, down_m])
                    away = from_edge(es, ns, zone_ring)
                    hit = inside(es, ns, zone_ring) & (hs > zone[1]) & (hs < zone[2])
                    note("return-no-fly", pair, np.where(hit, away, -np.maximum(away, 0.1)).max())
    return out


def _cut_corners(rows, parts):
    """PX4 goes on to the next waypoint when it is within 10 m, and at the waypoint's height."""
    out = []
    for (first, corner, phase, one), (_, last, next_phase, two) in itertools.pairwise(parts):
        if (phase, next_phase) != ("route", "route") or rows[corner - 1][0] != 16 or rows[corner - 1][2][0] > 0.0:
            continue
        before, after = one[0] - one[-1], two[-1] - two[0]
        in_m, out_m = np.hypot(*before[:2]), np.hypot(*after[:2])
        if min(in_m, out_m) < 1.0:
            continue
        u, v = -before[:2] / in_m, after[:2] / out_m
        if float(u @ v) > 0.9985 or float(u @ v) < -0.996:
            continue
        flat = early(u, v, min(10.0, in_m, out_m)) + two[0][:2]
        fraction = np.linspace(0.0, 1.0, len(flat))
        up = two[0][2] + fraction * min(10.0, in_m, out_m) * after[2] / out_m
        out.append((first, last, "turn", np.column_stack([flat, up])))
    return out


def shortest_time_s(rows, home, ground, *, return_m, px4, speed_m_s, climb_m_s, descent_m_s):
    """No flight along the path is faster: every leg at full speed, nothing lost at corners."""
    plane = Plane(*home)
    home_m = float(ground.height_m(np.array([home[0]]), np.array([home[1]]))[0])
    seconds = 0.0
    for *_, points in path(rows, plane, home_m, return_m, px4=px4):
        steps = np.diff(points, axis=0)
        flat = float(np.hypot(steps[:, 0], steps[:, 1]).sum()) / speed_m_s
        rise = (
            float(np.maximum(steps[:, 2], 0.0).sum()) / climb_m_s
            + float(np.maximum(-steps[:, 2], 0.0).sum()) / descent_m_s
        )
        seconds += max(flat, rise)
    return seconds
