import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.recording.flights import fly, lines_over
from tests.report.browser import Page, chromium_page
from uavcover.flight.resume import find_unfinished, save_rest
from uavcover.model.route import Plan, Route, RouteMember, RouteMetrics
from uavcover.model.track import Track, TrackSample
from uavcover.planner.plan_files import save_plan
from uavcover.report.content import ReportContent, read_run
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import TrackWriter
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site

HOSTILE = '</script><img src=x onerror="window.hacked=1"><!--{{ 7*7 }}&amp;\''
"""What would run, or end the data, if any text went into the page as it stands."""


def coarse(name: str, cell_size_m: float, **changes: object) -> Site:
    scenario = load_scenario(name)
    area = dataclasses.replace(scenario.area, cell_size_m=cell_size_m)
    return load_site(dataclasses.replace(scenario, area=area, **changes))  # type: ignore[arg-type]


def write_run(folder: Path, site: Site, route: Route, *, flown: bool, name: str = "boustrophedon") -> RunFolder:
    """A run folder as ``plan`` and ``fly`` leave it, of a route that nobody searched for."""
    run = RunFolder(folder)
    folder.mkdir()
    metrics = RouteMetrics(0.5, 0.5, len(route), route.length_m, route.length_m / 10.0, 60.0, 100.0, route.length_m)
    chosen = RouteMember(route, metrics, 0.0, name)
    other = RouteMember(route, dataclasses.replace(metrics, path_length_m=2.0 * route.length_m), 0.0, name)
    plan = Plan(chosen, (chosen, other), (other,), "coverage>=0.4", True, "imodbo", 40, 1.5)
    save_plan(run, site, plan, compiled=None, autopilot="ardupilot", seed=3, command=["uavcover", "plan"])
    if flown:
        write_track(run.file("track.csv"), fly(site, route.waypoints_m, speed_m_s=10.0, rate_hz=5.0))
    return run


def write_track(path: Path, track: Track) -> None:
    columns = (track.time_s, *track.geodetic.T, *track.enu_m.T, *track.attitude_deg.T)
    with TrackWriter(path) as writer:
        for row, waypoint in zip(zip(*columns, strict=True), track.current_waypoint, strict=True):
            writer.write(TrackSample(*map(float, row), int(waypoint)))


def two_sorties(folder: Path, site: Site) -> RunFolder:
    """A run that is flown as two sorties of two lines each; the vehicle was switched on anew for the second."""
    whole = lines_over(site, spacing_m=90.0, count=4)
    run = write_run(folder, site, whole, flown=False)
    half = len(whole) // 2
    for number, part in enumerate((whole.waypoints_m[:half], whole.waypoints_m[half:]), start=1):
        write_run(run.file(f"sortie-{number}"), site, Route(part), flown=True)
    return run


def resumed(folder: Path, site: Site, *, fraction: float = 0.13) -> RunFolder:
    """A run whose flight ended after a share of its time, and the flight that went on with it two minutes later."""
    route = lines_over(site, spacing_m=90.0, count=4)
    run = write_run(folder, site, route, flown=False)
    track = fly(site, route.waypoints_m, speed_m_s=10.0, rate_hz=5.0)
    end = round(fraction * len(track))
    write_track(run.file("track.csv"), cut(track, slice(0, end)))
    rest = find_unfinished(run, site)
    rest.folder.path.mkdir()
    save_rest(rest, site, command=["uavcover", "fly", "--resume"])
    onward = fly(site, rest.route.waypoints_m, speed_m_s=10.0, rate_hz=5.0)
    later = dataclasses.replace(onward, time_s=onward.time_s + float(track.time_s[end]) + 120.0)
    write_track(rest.folder.file("track.csv"), later)
    return run


def cut(track: Track, part: slice) -> Track:
    return track.taken(np.arange(len(track))[part])


def read_of_perfect_tracks(run: RunFolder, logs: Sequence[Path] = ()) -> ReportContent:
    """A run's content with attitudes that count: made-up tracks take corners in no time, and have no lean to confirm."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("uavcover.verification.attitude._unconfirmed", lambda *_: None)
        return read_run(run, logs=logs)


@pytest.fixture(scope="session")
def site() -> Site:
    return coarse("jacksboro", 20.0)


@pytest.fixture(scope="session")
def run(site: Site, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Four of eleven lines over the demo's area. Not to be changed: copy it."""
    route = lines_over(site, spacing_m=90.0, count=4)
    return write_run(tmp_path_factory.mktemp("report") / "run", site, route, flown=True)


@pytest.fixture(scope="session")
def content(run: RunFolder) -> ReportContent:
    return read_of_perfect_tracks(run)


@pytest.fixture(scope="session")
def html(content: ReportContent) -> str:
    return render_report(content)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium_page(tmp_path_factory.mktemp("chromium")) as page:
        yield page


@pytest.fixture
def page(browser: Page) -> Page:
    browser.complaints.clear()
    browser.requests.clear()
    return browser
