"""Falsified motion: routes that were drawn, flights put together from pieces, speeds that the vehicle has not."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.of_position import any_way
from tests.falsifying.of_time import thinned
from tests.falsifying.way import Way, family
from uavcover.kernels.arrays import FloatArray


def along(f: Flown, path_m: FloatArray, number: np.ndarray, *, speed_m_s: float, step_s: float) -> Flown:
    """A record of constant speed along a path, ``number[k]`` the waypoint that is flown to on the leg to point k."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path_m, axis=0), axis=1)))
    flown = np.append(np.arange(0.0, way[-1], speed_m_s * step_s), way[-1])
    enu = np.column_stack([np.interp(flown, way, path_m[:, axis]) for axis in range(3)])
    course = np.gradient(enu, axis=0)
    yaw = np.degrees(np.arctan2(course[:, 0], course[:, 1])) % 360.0
    return replace(
        f.placed(enu), time_s=f.time_s[0] + flown / speed_m_s,
        attitude_deg=np.column_stack([0.1 * np.sin(flown), -5.0 + 0.1 * np.cos(flown), yaw]),
        waypoint=number[np.searchsorted(way, flown, side="left")], attitude_age_s=_fresh(f, len(flown)),
        **_counted(f, len(flown)),
    )  # fmt: skip


def _counted(f: Flown, count: int) -> dict[str, FloatArray | None]:
    """Photos and times of day of a drawn record, evenly over its samples, where the honest one has them."""
    ends = {name: getattr(f, name) for name in ("photos_taken", "unix_time_s")}
    return {
        name: None if values is None else np.floor(np.linspace(*np.nanquantile(values, (0.0, 1.0)), count))
        for name, values in ends.items()
    }


def _fresh(f: Flown, count: int) -> FloatArray | None:
    """Attitudes of just now, where the record says how old they are."""
    return None if f.attitude_age_s is None else np.zeros(count)


def drawn_path(f: Flown) -> tuple[FloatArray, np.ndarray]:
    """The plan with straight ways there and home, high enough, and the waypoint numbers of its points."""
    home, first, last = f.enu_m[0], f.plan_m[0], f.plan_m[-1]
    top = max(float(f.enu_m[~f.on_route, 2].max()), first[2], last[2])
    over = [
        [home[0], home[1], top],
        [first[0], first[1], top],
        *f.plan_m,
        [last[0], last[1], top],
        [home[0], home[1], top],
    ]
    path = np.vstack([home, *over, home])
    number = np.concatenate([[-1, -1, 0], np.arange(len(f.plan_m)), [-1, -1, -1]])
    return path, number


@family("the plan as a track")
def drawn(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Nobody has flown it: corners are turned at full speed in no time."""
    cruise = flown.site.scenario.vehicle.cruise_speed_m_s
    path, number = drawn_path(flown)
    for speed, rate_hz in ((1.0, 10.0), (1.0, 5.0), (1.0, 1.0), (0.8, 50.0), (2.0, 10.0)):
        yield Way(
            f"at {speed * cruise:g} m/s, {rate_hz:g} Hz", "turns corners in no time, and starts and stops at once",
            lambda f, s=speed * cruise, r=rate_hz: along(f, path, number, speed_m_s=s, step_s=1.0 / r),
        )  # fmt: skip

    def corners_only(f: Flown) -> Flown:
        step_s = np.append(0.0, np.linalg.norm(np.diff(path, axis=0), axis=1)) / cruise
        return replace(
            f.placed(path), time_s=f.time_s[0] + np.cumsum(step_s + 1e-3), waypoint=number,
            attitude_deg=np.tile(f.attitude_deg[len(f) // 2], (len(path), 1)), attitude_age_s=_fresh(f, len(path)),
            **_counted(f, len(path)),
        )  # fmt: skip

    yield Way("its waypoints only", "nothing was observed in between", corners_only)

    def leaping(f: Flown) -> Flown:
        return replace(corners_only(f), time_s=f.time_s[0] + flown.step_s * np.arange(len(path)))

    yield Way("its waypoints only, one a sample", "hundreds of metres from one sample to the next", leaping)
    yield Way("the route alone, from its first waypoint", "it does not begin on the ground", lambda f: along(
        f, f.plan_m, np.arange(len(f.plan_m)), speed_m_s=cruise, step_s=0.1))  # fmt: skip


def noisy(change: Change, *, position_m: float, lean_deg: float, seed: int) -> Change:
    """White noise on the positions of a falsified record, and a random lean."""

    def changed(f: Flown) -> Flown:
        g, rng = change(f), np.random.default_rng(seed)
        g = g.placed(g.enu_m + rng.normal(0.0, position_m, (len(g), 3)) * [1.0, 1.0, 0.3])
        return replace(g, attitude_deg=np.column_stack([rng.normal(0.0, lean_deg, (len(g), 2)), g.attitude_deg[:, 2]]))

    return changed


def snapped(every_s: float) -> Change:
    """Samples this far apart, moved to the nearest point of the plan while they are on the route."""

    def change(f: Flown) -> Flown:
        g = thinned(1.0 / every_s)(f)
        enu = g.enu_m.copy()
        for k in np.flatnonzero(g.on_route):
            begin, end = f.plan_m[:-1], f.plan_m[1:]
            leg = end - begin
            at = np.clip(((enu[k] - begin) * leg).sum(axis=1) / np.maximum((leg**2).sum(axis=1), 1e-9), 0.0, 1.0)
            near = begin + at[:, None] * leg
            enu[k] = near[np.argmin(np.linalg.norm(near - enu[k], axis=1))]
        return g.placed(enu)

    return change


@family("noise as an excuse")
def excused(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """The plan as a track, with errors that no estimator makes, or too few samples to show its corners."""
    cruise = flown.site.scenario.vehicle.cruise_speed_m_s
    path, number = drawn_path(flown)
    why = "turns corners in no time; no receiver has errors that differ from sample to sample like that"
    for speed, rate_hz, position_m in (
        (1.0, 10.0, 1.0), (1.0, 10.0, 0.3), (1.0, 10.0, 0.1), (0.5, 10.0, 1.0), (0.5, 10.0, 0.2), (0.5, 5.0, 0.5),
        (1.0, 25.0, 1.0), (1.0, 2.0, 1.0), (1.0, 1.0, 1.0), (0.5, 1.0, 0.5),
    ):  # fmt: skip
        draw: Change = lambda f, s=speed, r=rate_hz: along(f, path, number, speed_m_s=s * cruise, step_s=1.0 / r)  # noqa: E731
        change = noisy(draw, position_m=position_m, lean_deg=2.0, seed=int(rng.integers(2**31)))
        yield Way(f"{speed * cruise:g} m/s, {rate_hz:g} Hz, off by {position_m:g} m, leaning at random", why, change)
    few = "turns corners in no time, between samples that are too far apart to show it"
    for speed, position_m in ((1.0, 0.0), (0.5, 0.0), (1.0, 0.3), (0.5, 0.3)):
        draw = lambda f, s=speed: along(f, path, number, speed_m_s=s * cruise, step_s=1.9)  # noqa: E731
        change = noisy(draw, position_m=position_m, lean_deg=2.0, seed=int(rng.integers(2**31)))
        yield Way(f"{speed * cruise:g} m/s, a sample every 1.9 s, off by {position_m:g} m", few, change)
        unknown: Change = lambda f, change=change: replace(g := change(f), attitude_deg=np.full((len(g), 3), np.nan))  # noqa: E731
        yield Way(f"{speed * cruise:g} m/s, a sample every 1.9 s, off by {position_m:g} m, no attitude", few, unknown)
    lean = lambda f: replace(g := snapped(1.9)(f), attitude_deg=np.full((len(g), 3), np.nan))  # noqa: E731
    yield Way("a sample every 1.9 s, on the plan, no attitude", few, lean)
    change = noisy(snapped(1.9), position_m=0.0, lean_deg=2.0, seed=int(rng.integers(2**31)))
    yield Way("a sample every 1.9 s, on the plan, leaning at random", few, change)


def interpolated(f: Flown, kept: FloatArray | np.ndarray) -> Flown:
    """The places between the ``kept`` samples read off straight lines, at all its times."""
    enu = np.column_stack([np.interp(f.time_s, f.time_s[kept], f.enu_m[kept, axis]) for axis in range(3)])
    return f.placed(enu)


@family("interpolated")
def filled(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Straight lines where nothing was observed."""
    for every_s in (10.0, 20.0, 40.0):

        def change(f: Flown, every_s: float = every_s) -> Flown:
            few = thinned(1.0 / every_s)(f)
            return interpolated(f, np.searchsorted(f.time_s, few.time_s))

        yield Way(f"between samples {every_s:g} s apart", "turns corners in no time", change)
    for fraction in (0.1, 0.3):
        at = float(rng.uniform(0.1, 0.6))

        def fast(f: Flown, at: float = at, fraction: float = fraction) -> Flown:
            begin_s, end_s = f.moment(at), f.moment(at + fraction)
            kept = f.taken(~f.between(begin_s, end_s))
            hole = 0.5
            time_s = kept.time_s - np.where(kept.time_s >= begin_s, end_s - begin_s - hole, 0.0)
            short = replace(kept, time_s=time_s)
            filling = np.linspace(begin_s, begin_s + hole, 6)[1:-1]
            rows = np.searchsorted(time_s, filling)
            enu = np.column_stack([np.interp(filling, time_s, short.enu_m[:, axis]) for axis in range(3)])
            order = np.insert(np.arange(len(short)), rows, rows - 1)
            longer = short.taken(order)
            fresh = np.insert(np.zeros(len(short), dtype=bool), rows, True)
            all_enu, all_time = longer.enu_m.copy(), longer.time_s.copy()
            all_enu[fresh], all_time[fresh] = enu, filling
            return replace(longer.placed(all_enu), time_s=all_time)

        yield Way(f"over {fraction:.0%} of the route, in half a second", "as fast as a bullet", fast)


@family("out of order")
def pieces(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Flights put together from pieces."""

    def reordered(f: Flown, order: np.ndarray) -> Flown:
        return replace(f.taken(order), time_s=f.time_s)

    yield Way(
        "last row first", "flies backwards through its waypoints", lambda f: reordered(f, np.arange(len(f))[::-1])
    )
    at = sorted(rng.uniform(0.1, 0.9, 2))

    def swapped(f: Flown) -> Flown:
        a, b, c = (int(np.searchsorted(f.time_s, f.moment(s))) for s in (at[0], 0.5 * (at[0] + at[1]), at[1]))
        number = np.arange(len(f))
        return reordered(f, np.concatenate([number[:a], number[b:c], number[a:b], number[c:]]))

    yield Way("two pieces of the route swapped", "leaps from piece to piece", swapped)
    seed = int(rng.integers(2**31))

    def shuffled(f: Flown) -> Flown:
        block = max(2, round(10.0 / f.step_s))
        blocks = np.split(np.arange(len(f)), np.arange(block, len(f), block))
        order = np.random.default_rng(seed).permutation(len(blocks))
        return reordered(f, np.concatenate([blocks[k] for k in order]))

    yield Way("pieces of 10 s shuffled", "leaps from piece to piece", shuffled)

    def twice(f: Flown) -> Flown:
        piece = f.taken(f.between(f.moment(0.3), f.moment(0.4)))
        before, after = f.taken(f.time_s < f.moment(0.4)), f.taken(f.time_s >= f.moment(0.4))
        lasts_s = f.moment(0.4) - f.moment(0.3)
        order = np.concatenate([np.arange(len(before)), np.flatnonzero(f.between(f.moment(0.3), f.moment(0.4))),
                                np.arange(len(before), len(f))])  # fmt: skip
        time_s = np.concatenate([before.time_s, piece.time_s + lasts_s, after.time_s + lasts_s])
        return replace(f.taken(order), time_s=time_s)

    yield Way("a piece of the route twice", "leaps back to where the piece began", twice)

    def backwards_half(f: Flown) -> Flown:
        number = np.arange(len(f))
        half = int(np.searchsorted(f.time_s, f.moment(0.5)))
        order = np.where(number < half, number, np.maximum(0, 2 * half - 1 - number))
        return replace(f.held(order), attitude_deg=f.attitude_deg[order])

    yield Way("the first half again, backwards, for the second", "half of the area was not seen", backwards_half)

    def mirrored_half(f: Flown) -> Flown:
        middle = f.plan_m.mean(axis=0)
        enu = f.enu_m.copy()
        late = f.between(f.moment(0.5), f.moment(1.0))
        early = np.flatnonzero(f.between(f.moment(0.0), f.moment(0.5)))
        source = early[np.minimum(np.arange(int(late.sum())), len(early) - 1)]
        enu[late] = np.column_stack([2.0 * middle[:2] - f.enu_m[source, :2], f.enu_m[source, 2]])
        return f.placed(enu)

    yield Way("the first half, mirrored, for the second", "leaps to where the mirrored half begins", mirrored_half)
    there = any_way(rng, 45.0)

    def pasted(f: Flown) -> Flown:
        later = f.between(f.moment(0.35), f.moment(0.65))
        number = np.arange(len(f))
        source = np.where(later, np.minimum(number + round(3.0 / f.step_s), len(f) - 1), number)
        other = f.held(source)
        return other.placed(other.enu_m + np.where(later[:, None], there, 0.0))

    yield Way("a piece of another flight pasted in", "leaps 45 m and more, there and back", pasted)
    yield Way(
        "the whole flight twice in a row", "is flown by one vehicle twice at once",
        lambda f: replace(f.taken(np.repeat(np.arange(len(f)), 2)), time_s=np.repeat(f.time_s, 2)),
    )  # fmt: skip


def oscillating(amplitude_m: float, period_s: float, axis: int) -> Change:
    """To and fro over the whole route."""

    def change(f: Flown) -> Flown:
        # Fades in and out, so that nothing leaps.
        fade = np.clip(np.minimum(f.time_s - f.moment(0.0), f.moment(1.0) - f.time_s) / 5.0, 0.0, 1.0)
        enu = f.enu_m.copy()
        enu[:, axis] += amplitude_m * fade * np.sin(2.0 * np.pi * f.time_s / period_s)
        return f.placed(enu)

    return change


@family("motion beyond the vehicle")
def motion(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Speeds and accelerations that it has not."""
    yield Way("weaves by 8 m twice in 3 s", "accelerates with 14 g", oscillating(8.0, 1.5, 0))
    yield Way("weaves by 40 m every 6 s", "4 g sideways, 40 m/s", oscillating(40.0, 6.0, 1))
    yield Way("heaves by 5 m every 2 s", "climbs and sinks with 15 m/s and 5 g", oscillating(5.0, 2.0, 2))
    at = float(rng.uniform(0.2, 0.6))

    def warped(f: Flown) -> Flown:
        # Smoothly four times as fast: the rate of time goes from 1 to 1/4 and back.
        begin_s, end_s = f.moment(at), f.moment(at + 0.3)
        phase = np.clip((f.time_s - begin_s) / (end_s - begin_s), 0.0, 1.0)
        rate = 1.0 - 0.75 * np.sin(np.pi * phase) ** 2
        step_s = np.diff(f.time_s) * 0.5 * (rate[1:] + rate[:-1])
        return replace(f, time_s=f.time_s[0] + np.append(0.0, np.cumsum(step_s)))

    yield Way("gets four times as fast, smoothly", "four times the speed of the vehicle", warped)

    def dropped(f: Flown) -> Flown:
        # Straight down on the ground from the end of the route's way home, in a second.
        end_s = f.time_s[-1]
        rest = f.time_s >= end_s - 20.0
        enu = f.enu_m.copy()
        high = int(np.argmax(rest))
        fraction = np.clip((f.time_s - f.time_s[high]) / 20.0 * 1.0, 0.0, 1.0)
        enu[rest, 2] = np.where(fraction[rest] < 0.97, enu[high, 2] + 60.0, f.enu_m[-1, 2])
        return f.placed(enu)

    yield Way("falls 60 m at the end, in no time", "no vehicle sinks so fast", dropped)

    def raised(f: Flown) -> Flown:
        # Up from the ground to the height of the route at once.
        early = f.time_s < f.moment(0.0)
        enu = f.enu_m.copy()
        moving = early & (f.enu_m[:, 2] - f.enu_m[0, 2] > 1.0)
        enu[moving, 2] = np.maximum(enu[moving, 2], f.enu_m[early, 2].max())
        return f.placed(enu)

    yield Way("up to the height of the route in one step", "no vehicle climbs so fast", raised)


@family("violations hidden")
def hidden(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """What was really flown left the limits; what shows it was taken out or renamed."""
    at = float(rng.uniform(0.25, 0.6))
    out = detour(at, 1.5 * flown.site.scenario.limits.fence_margin_m + 800.0)

    def inside(f: Flown) -> np.ndarray:
        import shapely

        return np.asarray(shapely.contains_xy(f.site.fence, f.enu_m[:, 0], f.enu_m[:, 1]))

    yield Way("left the fence", "left the fence", out)
    yield Way(
        "left the fence, outside samples deleted", "minutes are missing", lambda f: (g := out(f)).taken(inside(g))
    )

    def closed_up(f: Flown) -> Flown:
        g = out(f)
        keep = inside(g)
        step_s = np.diff(g.time_s, prepend=g.time_s[0] - f.step_s)
        kept = g.taken(keep)
        return replace(kept, time_s=g.time_s[0] + np.cumsum(step_s[keep]))

    if _fence_has_room(flown, at):
        yield Way(
            "left the fence, outside samples deleted and the clock closed up", "turns round in no time", closed_up
        )

    def frozen_outside(f: Flown) -> Flown:
        g = out(f)
        number = np.arange(len(g))
        return g.held(np.maximum.accumulate(np.where(inside(g), number, 0)))

    yield Way("left the fence, held at its edge instead", "stops at the fence in no time", frozen_outside)
    low = flown.site.scenario.limits.min_height_agl_m
    dip = lowered(0.2, 0.7, 0.5 * (low + min(low, flown.site.scenario.limits.transit_clearance_m)) - 0.5)
    yield Way("below the height band", "below the band", dip)
    yield Way(
        "below the height band, without waypoint numbers there", "below the band",
        lambda f: replace(g := dip(f), waypoint=np.where(f.between(f.moment(0.2), f.moment(0.7)), -1, g.waypoint)),
    )  # fmt: skip
    yield Way("below the height band, without any waypoint number", "below the band", lambda f: unnumbered(dip(f)))
    yield Way(
        "below the height band, low samples deleted", "a part of the route is missing",
        lambda f: (g := dip(f)).taken(~g.between(g.moment(0.2), g.moment(0.7))),
    )  # fmt: skip
    high = lowered(0.3, 0.6, flown.site.scenario.limits.max_height_agl_m + 15.0)
    yield Way("above the height band", "above the band", high)
    yield Way(
        "above the height band, without waypoint numbers there", "above the band",
        lambda f: replace(g := high(f), waypoint=np.where(f.between(f.moment(0.3), f.moment(0.6)), -1, g.waypoint)),
    )  # fmt: skip
    yield Way("above the height band, every sample of way 0", "above the band",
              lambda f: replace(g := high(f), waypoint=np.minimum(g.waypoint, 0)))  # fmt: skip


def unnumbered(f: Flown) -> Flown:
    """Without any waypoint number, as a foreign log."""
    return replace(f, waypoint=np.full(len(f), -1))


def lowered(begin: float, end: float, to_agl_m: float) -> Change:
    """At another height above ground for a part of the route, gone to and left at a rate that the vehicle has."""

    def change(f: Flown) -> Flown:
        ground = f.site.ground.heights_m(f.enu_m[:, :2])
        ramp_s = max(15.0, abs(float(np.median(f.enu_m[f.on_route, 2] - ground[f.on_route])) - to_agl_m) / 1.5)
        inside = np.minimum(f.time_s - f.moment(begin), f.moment(end) - f.time_s)
        fraction = np.clip(inside / min(ramp_s, 0.4 * (f.moment(end) - f.moment(begin))), 0.0, 1.0)
        fraction = fraction * fraction * (3.0 - 2.0 * fraction)
        wanted = ground + to_agl_m
        return f.placed(np.column_stack([f.enu_m[:, :2], f.enu_m[:, 2] + fraction * (wanted - f.enu_m[:, 2])]))

    return change


def detour(at: float, away_m: float) -> Change:
    """From a moment of the route straight away from the middle and back, with a smooth start, stop and turn."""

    def change(f: Flown) -> Flown:
        here = int(np.searchsorted(f.time_s, f.moment(at)))
        speed = f.site.scenario.vehicle.cruise_speed_m_s
        out = f.enu_m[here, :2] - f.plan_m[:, :2].mean(axis=0)
        out = out / max(1e-9, float(np.hypot(*out)))
        lasts_s = np.pi * away_m / speed
        ticks = np.arange(f.step_s, lasts_s, f.step_s)
        far = away_m * np.sin(np.pi * ticks / lasts_s) ** 2
        count = len(ticks)
        order = np.concatenate([np.arange(here + 1), np.full(count, here), np.arange(here + 1, len(f))])
        g = f.taken(order)
        enu, time_s = g.enu_m.copy(), g.time_s.copy()
        middle = slice(here + 1, here + 1 + count)
        enu[middle, :2] += far[:, None] * out
        ground = f.site.ground.heights_m(enu[middle, :2])
        agl = f.enu_m[here, 2] - float(f.site.ground.heights_m(f.enu_m[here : here + 1, :2])[0])
        enu[middle, 2] = np.where(np.isfinite(ground), np.maximum(ground + agl, enu[middle, 2]), enu[middle, 2])
        time_s[middle] = f.time_s[here] + ticks
        time_s[here + 1 + count :] += ticks[-1]
        return replace(g.placed(enu), time_s=time_s)

    return change


def _fence_has_room(f: Flown, at: float) -> bool:
    """Whether a detour from there turns round outside the fence, so that cutting it off shows."""
    return bool(len(detour(at, 1.5 * f.site.scenario.limits.fence_margin_m + 800.0)(f)) > len(f))
