"""A log is cut into flights where its vehicle stands on the ground, and nowhere else."""

import numpy as np
import pytest

from tests.verification.flights import LEANING_DEG, Flight, changed, track_of
from uavcover.model.track import Track
from uavcover.verification.run_logs import flights_in

pytestmark = pytest.mark.usefixtures("attitudes_count")


def without_numbers(flight: Flight, *pieces: tuple[np.ndarray, np.ndarray]) -> Track:
    """Positions and times of pieces one after the other."""
    enu = np.vstack([piece[0] for piece in pieces])
    time_s = np.concatenate([piece[1] for piece in pieces])
    track = track_of(flight.site, enu, time_s=time_s, current_waypoint=np.full(len(enu), -1, dtype=np.int64))
    attitude = track.attitude_deg.copy()
    attitude[np.cumsum([0, *(len(piece[0]) for piece in pieces[:-1])])] = LEANING_DEG
    return changed(track, attitude_deg=attitude)


def flown_and_standing(flight: Flight, begin_s: float, stand_s: float, *, up_m: float = 0.0, every_s: float = 0.2):
    """The flight from a time on, with its vehicle standing before and after."""
    track, rest = flight.track, np.arange(0.0, stand_s, every_s)
    down = np.array([0.0, 0.0, up_m])
    enu = np.vstack(
        [np.tile(track.enu_m[0] + down, (len(rest), 1)), track.enu_m, np.tile(track.enu_m[-1] + down, (len(rest), 1))]
    )
    flown_s = track.time_s - track.time_s[0] + stand_s
    return enu, begin_s + np.concatenate([rest, flown_s, flown_s[-1] + every_s + rest])


@pytest.mark.parametrize("pause_s", [0.2, 3.0, 300.0])
def test_two_flights_in_one_log(level: Flight, pause_s: float) -> None:
    first = flown_and_standing(level, 0.0, 4.0)
    track = without_numbers(level, first, flown_and_standing(level, first[1][-1] + pause_s, 4.0))
    one, two = flights_in(track, level.site)
    assert len(one) + len(two) == len(track)
    assert abs(len(one) - len(two)) <= 1
    assert not level.verify(track).passed
    reports = [level.verify(each) for each in (one, two)]
    assert [report.verdict for report in reports] == ["passed", "passed"], [report.doubts for report in reports]


def test_one_flight_stays_whole(level: Flight) -> None:
    enu, time_s = flown_and_standing(level, 0.0, 60.0)
    whole = without_numbers(level, (enu, time_s))
    assert [len(each) for each in flights_in(whole, level.site)] == [len(whole)]
    # Hovering above home is no standing, and a short touch is none either.
    high = without_numbers(
        level, flown_and_standing(level, 0.0, 20.0, up_m=15.0), flown_and_standing(level, 500.0, 20.0, up_m=15.0)
    )
    touch = without_numbers(level, flown_and_standing(level, 0.0, 1.0), flown_and_standing(level, 200.0, 1.0))
    assert len(flights_in(high, level.site)) == 1
    touched = changed(touch, time_s=np.linspace(0.0, 400.0, len(touch)))
    assert len(flights_in(touched, level.site)) == 1
    # A record of uavcover has numbers and is one flight.
    assert flights_in(level.track, level.site) == [level.track]
