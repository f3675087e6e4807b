"""Falsified attitude, waypoint numbers and text."""

import io
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.falsifying.flown import Change, Flown
from tests.falsifying.of_time import at_date, clocks_apart, has_timed_zones
from tests.falsifying.of_unreported_photos import honest_reports
from tests.falsifying.of_velocity import honest_velocities
from tests.falsifying.way import Way, family
from uavcover.model.track import COLUMNS


def turned(how: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Another attitude, of (n, 3) roll, pitch and yaw in degrees."""
    return lambda f: replace(f, attitude_deg=how(f.attitude_deg))


def _leaned(how: Callable[[Flown], np.ndarray]) -> Change:
    """Another (n, 2) roll and pitch."""
    return lambda f: replace(f, attitude_deg=np.column_stack([how(f), f.attitude_deg[:, 2]]))


def late(by_s: float) -> Change:
    """Roll and pitch of another time."""
    return _leaned(
        lambda f: np.column_stack([np.interp(f.time_s - by_s, f.time_s, a) for a in f.attitude_deg[:, :2].T])
    )


def random_lean(sigma_deg: float, seed: int) -> Change:
    """Roll and pitch at random."""
    return _leaned(lambda f: np.random.default_rng(seed).normal(0.0, sigma_deg, (len(f), 2)))


UNMEASURED: dict[str, Callable[[int], Change]] = {
    "roll and pitch reversed in time": lambda _: _leaned(lambda f: f.attitude_deg[::-1, :2]),
    "roll and pitch 5 s late": lambda _: late(5.0),
    "roll and pitch 2 s late": lambda _: late(2.0),
    "roll and pitch 3 s early": lambda _: late(-3.0),
    "roll and pitch scaled to a third": lambda _: _leaned(lambda f: f.attitude_deg[:, :2] / 3.0),
    "roll and pitch doubled": lambda _: _leaned(lambda f: f.attitude_deg[:, :2] * 2.0),
    "roll and pitch exchanged": lambda _: _leaned(lambda f: f.attitude_deg[:, 1::-1]),
    "3 degrees of noise for roll and pitch": lambda seed: random_lean(3.0, seed),
    "1 degree of noise for roll and pitch": lambda seed: random_lean(1.0, seed),
    "yaw off by 90 degrees, roll and pitch as they were": lambda _: turned(
        lambda a: np.column_stack([a[:, :2], (a[:, 2] + 90.0) % 360.0])
    ),
}
"""Plausible in every sample, and not measured in flight."""

UNRELATED = tuple(name for name in UNMEASURED if not name.endswith(("to a third", "doubled")))
"""Of these a part of a flight tells enough: a wrong size hides in gusts and noise where the vehicle turns seldom."""
_LONG_ENOUGH_S = 110.0
"""Of a route whose half is tested: a minute has two turns. Of half a minute the motion tells too little."""


def _for_half(change: Change) -> Change:
    def half(f: Flown) -> Flown:
        late = f.between(f.moment(0.5), f.moment(1.0))[:, None]
        return replace(f, attitude_deg=np.where(late, change(f).attitude_deg, f.attitude_deg))

    return half


@family("attitude")
def attitude(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Where the camera looked; only for one that turns with the vehicle."""
    sensor = flown.site.scenario.sensor
    if sensor.mount != "fixed":
        return
    fraction = float(rng.uniform(0.2, 0.5))
    unknown = "where a camera looked that turns with the vehicle is not known"
    yield Way("radians as degrees", unknown, turned(np.radians))
    yield Way("720 degrees added", unknown, turned(lambda a: a + 720.0))
    yield Way("roll of 400 degrees", unknown, turned(lambda a: a + [400.0, 0.0, 0.0]))
    yield Way("times ten", unknown, turned(lambda a: a * 10.0))
    yield Way("all zero", unknown, turned(lambda a: 0.0 * a))
    yield Way("roll and pitch zero, yaw as it was", unknown, turned(lambda a: a * [0.0, 0.0, 1.0]))
    yield Way("missing", unknown, turned(lambda a: a + np.nan))
    yield Way("roll and pitch missing", unknown, turned(lambda a: a + [np.nan, np.nan, 0.0]))
    yield Way("that of one sample throughout", unknown, turned(lambda a: np.tile(a[len(a) // 2], (len(a), 1))))
    yield Way("missing for half of the route", unknown, lambda f: replace(f, attitude_deg=np.where(
        f.between(f.moment(fraction), f.moment(fraction + 0.5))[:, None], np.nan, f.attitude_deg)))  # fmt: skip
    yield Way("missing but for a sample every 40 s", unknown, lambda f: replace(f, attitude_deg=np.where(
        (np.arange(len(f)) % round(40.0 / f.step_s) != 0)[:, None], np.nan, f.attitude_deg)))  # fmt: skip
    for age_s in (1.5, -30.0):
        yield Way(f"{age_s:g} s old", unknown, lambda f, age_s=age_s: replace(f, attitude_age_s=np.full(len(f), age_s)))
    no_lean = "no multirotor that moves like that leans like that"
    sway = np.sin(2.0 * np.pi * (flown.time_s - flown.time_s[0]) / float(rng.uniform(4.0, 9.0)))
    roll_deg = float(rng.choice([-1.0, 1.0]) * rng.uniform(15.0, 30.0))
    yield Way("rolled to one side throughout", no_lean, turned(lambda a: a + [roll_deg, 0.0, 0.0]))
    yield Way("pitched up throughout", no_lean, turned(lambda a: a + [0.0, abs(roll_deg) + 8.0, 0.0]))
    yield Way("swaying", no_lean, turned(lambda a: a + np.outer(sway, [30.0, 0.0, 0.0])))
    yield Way("mirrored", no_lean, turned(lambda a: a * [-1.0, -1.0, 1.0]))
    yield Way("spinning", no_lean, lambda f: replace(f, attitude_deg=np.column_stack(
        [f.attitude_deg[:, :2], (f.attitude_deg[:, 2] + 25.0 * f.time_s) % 360.0])))  # fmt: skip
    for name, change in UNMEASURED.items():
        yield Way(name, "nothing measured this attitude when the vehicle was there", change(int(rng.integers(2**31))))
    for name in UNRELATED if flown.moment(1.0) - flown.moment(0.0) > _LONG_ENOUGH_S else ():
        change = UNMEASURED[name](int(rng.integers(2**31)))
        yield Way(f"{name}, for half of the route", "nothing measured this attitude there", _for_half(change))
    away = "no vehicle flies a route in this way"
    yield Way("rolled away by 70 degrees", away, turned(lambda a: a + [70.0, 0.0, 0.0]))
    yield Way("pitched away by 70 degrees", away, turned(lambda a: a + [0.0, 70.0, 0.0]))
    yield Way("upside down", "the camera looks at the sky", turned(lambda a: a + [180.0, 0.0, 0.0]))
    across, along = getattr(sensor, "fov_across_deg", None), getattr(sensor, "fov_along_deg", None)
    if across is not None and along is not None and across > 1.5 * along:
        yield Way(
            "yaw off by 90 degrees", "the narrow side of the picture lies across the lines",
            turned(lambda a: np.column_stack([a[:, :2], (a[:, 2] + 90.0) % 360.0])),
        )  # fmt: skip


def numbered(how: Callable[[Flown], np.ndarray]) -> Change:
    """Other waypoint numbers."""
    return lambda f: replace(f, waypoint=np.asarray(how(f), dtype=np.int64))


@family("waypoint numbers")
def waypoints(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Numbers that say another way through the plan than the places do."""
    wrong = "the numbers say another way through the plan than the places"
    seed, count = int(rng.integers(2**31)), len(flown.plan_m)
    yield Way("random", wrong, numbered(lambda f: np.random.default_rng(seed).integers(0, count, len(f))))
    yield Way("constant, of the whole flight", wrong, numbered(lambda f: np.full(len(f), count // 2)))
    yield Way("backwards", wrong, numbered(lambda f: np.where(f.waypoint >= 0, count - 1 - f.waypoint, -1)))
    yield Way(
        "beyond the plan",
        "the plan has no such waypoint",
        numbered(lambda f: np.where(f.waypoint >= 0, f.waypoint + 1000, -1)),
    )
    yield Way(
        "on the route only for its first quarter", "most of the area was not seen on the route",
        numbered(lambda f: np.where(f.time_s <= f.moment(0.25), f.waypoint, 0)),
    )  # fmt: skip


def _rewritten(how: Callable[[str], str]) -> Callable[[bytes], bytes]:
    return lambda text: how(text.decode()).encode()


def _half_with_semicolons(text: str) -> str:
    """Two dialects in one file; one of them alone is read."""
    return "".join(
        line.replace(",", ";") if number % 2 else line for number, line in enumerate(text.splitlines(keepends=True))
    )


def _cell(column: str, value: str, fraction: float) -> Callable[[bytes], bytes]:
    """One value of one row."""

    def rewrite(text: str) -> str:
        lines = text.splitlines()
        row = 1 + int(fraction * (len(lines) - 2))
        cells = lines[row].split(",")
        cells[COLUMNS.index(column)] = value
        lines[row] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return _rewritten(rewrite)


def _header(change: dict[str, str]) -> Callable[[bytes], bytes]:
    def rewrite(text: str) -> str:
        head, _, rest = text.partition("\n")
        return ",".join(change.get(name, name) for name in head.split(",")) + "\n" + rest

    return _rewritten(rewrite)


def _without_column(column: str) -> Callable[[bytes], bytes]:
    position = COLUMNS.index(column)

    def rewrite(text: str) -> str:
        rows = [line.split(",") for line in text.splitlines()]
        return "".join(",".join(row[:position] + row[position + 1 :]) + "\n" for row in rows)

    return _rewritten(rewrite)


@family("text")
def text(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Files that are no whole track."""
    for value in ("nan", "inf", "-inf", "", "x", "1e999"):
        for column in ("time_s", "lat_deg", "alt_amsl_m", "up_m", "current_waypoint"):
            if rng.random() < 0.4 or (value, column) in (("nan", "lat_deg"), ("", "lat_deg"), ("inf", "alt_amsl_m")):
                fraction = float(rng.uniform(0.1, 0.9))
                yield Way(
                    f"{value or 'nothing'!r} in {column}", "no place and time", rewrite=_cell(column, value, fraction)
                )
    yield Way("roll of a sample is inf", "no attitude", rewrite=_cell("roll_deg", "inf", 0.5))
    for column in ("time_s", "lat_deg", "alt_amsl_m", "east_m"):
        yield Way(f"without the column {column}", "it is not a track", rewrite=_without_column(column))
    yield Way(
        "latitude and longitude swapped in the header", "elsewhere",
        rewrite=_header({"lat_deg": "lon_deg", "lon_deg": "lat_deg"}),
    )  # fmt: skip
    yield Way(
        "up and height swapped in the header",
        "in the air",
        rewrite=_header({"alt_amsl_m": "up_m", "up_m": "alt_amsl_m"}),
    )
    yield Way("roll and yaw swapped in the header", "the vehicle rolls through all directions",
              rewrite=_header({"roll_deg": "yaw_deg", "yaw_deg": "roll_deg"}))  # fmt: skip
    yield Way("a column twice", "which one counts?", rewrite=_header({"roll_deg": "east_m"}))
    for fraction in (0.5, 0.9):
        yield Way(f"cut off at {fraction:.0%}", "ends in the air", rewrite=lambda b, s=fraction: b[: int(s * len(b))])
    yield Way("the header again in the middle", "it is not a number", rewrite=_rewritten(_header_again))
    yield Way("the file twice", "time goes back", rewrite=lambda b: b + b)
    yield Way("semicolons on every other line", "it is not a track", rewrite=_rewritten(_half_with_semicolons))
    yield Way("the header alone", "nothing was flown", rewrite=lambda b: b[: b.index(b"\n") + 1])
    yield Way("empty", "nothing was flown", rewrite=lambda _: b"")
    yield Way("zeros in the middle", "a disk that failed", rewrite=_zeroed)
    yield Way("binary", "no text", rewrite=lambda _: bytes(np.random.default_rng(1).integers(0, 256, 4096, np.uint8)))
    yield Way("rows without their last values", "incomplete",
              rewrite=_rewritten(lambda t: "".join(",".join(line.split(",")[:9]) + "\n" for line in t.splitlines())))  # fmt: skip


def _header_again(whole: str) -> str:
    lines = whole.splitlines()
    return "\n".join([*lines[: len(lines) // 2], lines[0], *lines[len(lines) // 2 :]]) + "\n"


def _zeroed(content: bytes) -> bytes:
    half = len(content) // 2
    return content[:half] + bytes(1000) + content[half + 1000 :]


@family("honest")
def honest(flown: Flown, rng: np.random.Generator) -> Iterator[Way]:
    """Changes that take nothing away: whoever refuses these proves nothing by refusing the others."""
    none = "the same flight"
    if has_timed_zones(flown):
        yield Way("with the date of today", none, at_date(time.time()), honest=True)
        return
    yield Way("as it is", none, lambda f: f, honest=True)
    yield Way("with a byte order mark", none, rewrite=lambda b: b"\xef\xbb\xbf" + b, honest=True)
    yield Way("Windows line ends", none, rewrite=lambda b: b.replace(b"\n", b"\r\n"), honest=True)
    yield Way("the last line cut off", none, rewrite=lambda b: b[:-15], honest=True)
    yield Way("columns in another order", none, rewrite=_rewritten(_columns_reversed), honest=True)
    yield Way("a column more", none, rewrite=_rewritten(_column_more), honest=True)
    yield Way(
        "six decimals of a degree, heights in centimetres", none,
        lambda f: f.located(np.column_stack([np.round(f.geodetic[:, :2], 6), np.round(f.geodetic[:, 2], 2)])), honest=True,
    )  # fmt: skip
    yield Way("without waypoint numbers", none, lambda f: replace(f, waypoint=np.full(len(f), -1)), honest=True)
    if flown.step_s <= 0.5:
        yield Way("one sample a second", none, lambda f: f.taken(_one_a_second(f)), honest=True)
    yield Way("the satellites' clock, set right by 2 s", none, clocks_apart(2.0, 0.4), honest=True)
    yield Way("switched on an hour earlier", none, lambda f: replace(f, time_s=f.time_s + 3600.0), honest=True)
    middle = float(rng.uniform(0.3, 0.7))
    if flown.moment(1.0) - flown.moment(0.0) > 300.0:
        yield Way("1.5 s without samples", none, lambda f: f.taken(
            ~f.between(f.moment(middle), f.moment(middle) + 1.5)), honest=True)  # fmt: skip
    yield from honest_reports(flown, rng)
    yield from honest_velocities(flown, rng)


def _one_a_second(f: Flown) -> np.ndarray:
    ticks = np.floor(f.time_s - f.time_s[0] + 1e-9)
    keep = np.append(True, np.diff(ticks) > 0)
    keep[-1] = True
    return keep


def _columns_reversed(whole: str) -> str:
    return "".join(",".join(line.split(",")[::-1]) + "\n" for line in whole.splitlines())


def _column_more(whole: str) -> str:
    lines = io.StringIO(whole).read().splitlines()
    return "\n".join([lines[0] + ",battery_v", *(line + ",12.4" for line in lines[1:])]) + "\n"
