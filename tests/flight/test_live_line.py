"""The line that shows what a vehicle in flight does."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, Mode
from mission_io.wire import messages as m
from uavcover.flight.flight_log import LiveLine
from uavcover.flight.orders import custom_mode
from uavcover.model.route import Route
from uavcover.model.track import TrackSample
from uavcover.scenario.site import Site, load_site

POSITION = m.GlobalPositionInt(100.0, 36.48, -84.22, 500.0, 60.0, 3.0, 4.0, 0.0, 0.0)
STATUS = m.SysStatus(0, 0, 0, 0.0, 15.2, 10.0, 87)


@pytest.fixture(scope="module")
def site() -> Site:
    return load_site("jacksboro")


def line(
    site: Site, messages: dict[type, Any], *, mode: Mode = Mode.MISSION, covered: float | None = 0.424,
    link: SimpleNamespace | None = None,
) -> LiveLine:  # fmt: skip
    vehicle: Any = SimpleNamespace(
        client=SimpleNamespace(
            vehicle=SimpleNamespace(autopilot=ARDUPILOT, custom_mode=custom_mode(ARDUPILOT, mode)),
            statistics=link or SimpleNamespace(frames_in=0, lost=0),
        ),
        monitor=SimpleNamespace(latest=messages.get),
        autopilot="ardupilot",
    )
    assert site.home_m is not None
    route = Route(site.home_m + np.array([[0.0, 100.0, 60.0], [0.0, 300.0, 60.0], [0.0, 500.0, 60.0]]))
    return LiveLine(site, route, vehicle, covered=lambda: covered)


def sample(site: Site, north_m: float, waypoint: int) -> TrackSample:
    assert site.home_m is not None
    east_m, home_north_m, up_m = site.home_m
    return TrackSample(
        100.0, 36.48, -84.22, 500.0, east_m, home_north_m + north_m, up_m + 60.0, 0.0, 0.0, 0.0, waypoint
    )


def test_everything_is_in_it(site: Site) -> None:
    shown = line(site, {m.GlobalPositionInt: POSITION, m.SysStatus: STATUS})
    at = sample(site, 200.0, 1)
    text = shown.text(at)
    height_m = float(site.ground.heights_agl_m(np.array([[at.east_m, at.north_m, at.up_m]]))[0])
    assert text.startswith(
        f"mission, waypoint 1 of 3, {height_m:.0f} m AGL, 5.0 m/s, battery 87 %, home 200 m, covered 42 %, "
    )
    assert text.endswith(" left")


def test_the_link_is_that_of_the_last_lines(site: Site) -> None:
    link = SimpleNamespace(frames_in=1000, lost=900)
    shown, at = line(site, {}, link=link), sample(site, 200.0, 1)
    assert "link" not in shown.text(at), "one count says nothing"
    link.frames_in, link.lost = 1090, 910
    assert "link 90 %" in shown.text(at)
    for _ in range(30):
        link.frames_in += 10
        text = shown.text(at)
    assert "link 100 %" in text


def test_time_left_falls_along_the_flight(site: Site) -> None:
    shown = line(site, {})
    lefts = []
    for north_m, waypoint in (
        (0.0, 0),
        (90.0, 0),
        (110.0, 1),
        (290.0, 1),
        (310.0, 2),
        (490.0, 2),
        (450.0, -1),
        (0.0, -1),
    ):
        minutes, seconds = shown.text(sample(site, north_m, waypoint)).split(", ")[-1].removesuffix(" left").split(":")
        lefts.append(60 * int(minutes) + int(seconds))
    assert lefts == sorted(lefts, reverse=True)
    assert lefts[0] > 1000.0 / 12.0
    assert 10 < lefts[-1] < 60, "the landing"


def test_what_is_not_known_is_left_out(site: Site) -> None:
    text = line(site, {}, covered=None).text(sample(site, 200.0, 1))
    assert "battery" not in text
    assert "m/s" not in text
    assert "covered" not in text
    assert "nan" not in text


def test_in_another_mode_it_is_not_on_its_way_home(site: Site) -> None:
    shown = line(site, {}, mode=Mode.HOLD)
    shown.text(sample(site, 490.0, 2))
    assert "waypoint 2 of 3" in shown.text(sample(site, 490.0, -1))
    homeward = line(site, {})
    homeward.text(sample(site, 490.0, 2))
    assert "homeward" in homeward.text(sample(site, 450.0, -1))


def test_ground_without_data_is_no_height(site: Site) -> None:
    assert math.isnan(site.ground.heights_agl_m(np.array([[0.0, 1e6, 0.0]]))[0])
    assert " m AGL" not in line(site, {}).text(sample(site, 1e6, 1))


def test_on_the_way_home_after_a_stop_no_planned_waypoint_is_flown_to(site: Site) -> None:
    shown = line(site, {})
    shown.text(sample(site, 300.0, 1))
    text = shown.text(sample(site, 250.0, -1))
    assert "off the planned route" in text
    assert "left" not in text
