"""Several flights in one report: each with its own colour and name, one after the other on one clock."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.recording.flights import lines_over
from tests.report.browser import Page
from tests.report.conftest import cut, read_of_perfect_tracks, resumed, two_sorties, write_track
from tests.report.test_charts import points
from uavcover.report import plots
from uavcover.report.charts import WIDE, Chart
from uavcover.report.content import ReportContent, read_run
from uavcover.report.map_data import map_data
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site

FLIGHTS = {
    "sorties": (two_sorties, ["sortie-1/track.csv", "sortie-2/track.csv"]),
    "resumed": (resumed, ["track.csv", "resumed-1/track.csv"]),
}


@pytest.fixture(scope="module", params=list(FLIGHTS))
def several(request: pytest.FixtureRequest, site: Site, tmp_path_factory: pytest.TempPathFactory) -> ReportContent:
    make: Callable[[Path, Site], RunFolder] = FLIGHTS[request.param][0]
    return read_of_perfect_tracks(make(tmp_path_factory.mktemp("several") / "run", site))


def charts(content: ReportContent) -> dict[str, Chart]:
    assert content.verdict is not None
    drawn = (
        plots.elevation_profile(content),
        plots.height_along_route(content),
        plots.height_over_time(content, content.verdict),
        plots.coverage_over_time(content, content.verdict),
    )
    return {chart.name: chart for chart in drawn}


def lines_of(chart: Chart) -> list[tuple[str, str, np.ndarray]]:
    """Style, name and places of the lines of flights."""
    return [(line.style, line.name, points(line.path)) for line in chart.wide.lines if line.style.startswith("flight-")]


def test_every_chart_shows_every_flight_in_its_own_style(several: ReportContent) -> None:
    names = [flight.name for flight in several.flights]
    assert names in [expected for _, expected in FLIGHTS.values()]
    for chart in charts(several).values():
        drawn = lines_of(chart)
        assert [style for style, _, _ in drawn] == ["flight-0", "flight-1"]
        assert all(name in key for name, (_, key, _) in zip(names, drawn, strict=True))


def test_flights_follow_each_other_and_fill_the_axis(several: ReportContent) -> None:
    for name in ("height", "coverage"):
        chart = charts(several)[name]
        (_, _, first), (_, _, second) = lines_of(chart)
        assert first[0, 0] == pytest.approx(WIDE.left, abs=0.1)
        assert second[-1, 0] == pytest.approx(WIDE.width - WIDE.right, abs=0.1)
        # The pause between them is a few seconds of several minutes.
        assert 0.0 < second[0, 0] - first[-1, 0] < 10.0
        total_s = sum(flight.duration_s for flight in several.flights)
        assert 60.0 * chart.x_range[1] == pytest.approx(total_s, abs=5.0)


def test_coverage_goes_on_where_the_flight_before_has_left_it(several: ReportContent) -> None:
    (_, _, first), (_, _, second) = lines_of(charts(several)["coverage"])
    # Upwards is less in a picture.
    assert second[0, 1] == pytest.approx(first[-1, 1], abs=0.5)
    assert second[-1, 1] < first[-1, 1] < first[0, 1]


def test_each_flight_lies_where_it_was_along_the_whole_route(several: ReportContent) -> None:
    whole = several.planned.route.waypoints_m
    at_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(whole, axis=0), axis=1)))
    ends = []
    for flight in several.flights:
        on, km = plots.flown_along(several, flight)
        assert np.isfinite(km).all()
        # Slow twin: the nearest of many places along the whole route, no further from the sample than the vehicle was.
        for k in range(0, len(on), 40):
            position = [np.interp(1000.0 * km[k], at_m, whole[:, axis]) for axis in range(2)]
            assert np.hypot(*(np.array(position) - flight.enu_m[on[k], :2])) < 6.0
        ends.append((km[0], km[-1]))
    (first_start, first_end), (second_start, second_end) = ends
    assert first_start < 0.02
    assert second_end == pytest.approx(at_m[-1] / 1000.0, abs=0.02)
    assert second_start == pytest.approx(first_end, abs=0.12)


def test_a_flight_of_another_plan_is_not_laid_along_this_one(site: Site, content: ReportContent) -> None:
    other = lines_over(site, spacing_m=70.0, count=2)
    (flight,) = content.flights
    elsewhere = dataclasses.replace(flight, planned_m=other.waypoints_m + np.array([3.0, 1.0, 0.0]))
    _, km = plots.flown_along(content, elsewhere)
    assert np.isnan(km).all()


def test_the_map_has_every_track_on_the_clock_of_the_charts(several: ReportContent) -> None:
    tracks = map_data(several)["tracks"]
    assert [track["name"] for track in tracks] == [flight.name for flight in several.flights]
    assert [track["style"] for track in tracks] == ["flight-0", "flight-1"]
    assert tracks[0]["times"][0] == 0.0
    assert tracks[1]["times"][0] > tracks[0]["times"][-1]


def test_both_flights_in_a_browser(page: Page, several: ReportContent, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(render_report(several))
    page.open(path)
    overlays = page.run(
        "[...document.querySelectorAll('.leaflet-control-layers-overlays label')].map(l => l.textContent.trim())"
    )
    assert [name for name in overlays if name.startswith("Flown")] == [f"Flown: {f.name}" for f in several.flights]
    shown = page.run(
        "['flight-0', 'flight-1'].map(s => document.querySelector('#map path.track.' + s).getAttribute('stroke'))"
    )
    drawn = page.run(
        "['flight-0', 'flight-1'].map(s => [...document.querySelectorAll('#chart-height .line-' + s)]"
        ".map(l => getComputedStyle(l).stroke))"
    )
    assert shown[0] != shown[1]
    assert [rgb(color) for color in shown] == [tuple(map(int, re.findall(r"\d+", strokes[0]))) for strokes in drawn]
    chart = "document.querySelector('[data-chart=\"height\"]')"
    reported = []
    for fraction in (0.1, 0.95):
        page.run(
            f"(() => {{ const b = {chart}.getBoundingClientRect(); {chart}.dispatchEvent(new PointerEvent('pointermove',"
            f" {{clientX: b.x + b.width * {fraction}, clientY: b.y + 20}})) }})()"
        )
        reported.append(page.run("document.querySelector('#chart-height output').textContent"))
    assert [words.split(",")[0] for words in reported] == [flight.name for flight in several.flights]
    assert page.complaints == []


def test_a_hostile_name_of_a_log_is_text_in_the_layer_control(
    page: Page, content: ReportContent, run: RunFolder, tmp_path: Path
) -> None:
    track = content.flights[0].track
    logs = [tmp_path / "<img src=x onerror=hacked=1>.csv", tmp_path / "b.csv"]
    half = len(track) // 2
    write_track(logs[0], cut(track, slice(0, half)))
    write_track(logs[1], cut(track, slice(half, None)))
    path = tmp_path / "report.html"
    path.write_text(render_report(read_run(run, logs=logs)))
    page.open(path)
    assert page.run("window.hacked ?? null") is None
    assert page.run("document.querySelectorAll('img[src=x]').length") == 0
    assert any(
        "onerror" in text
        for text in page.run(
            "[...document.querySelectorAll('.leaflet-control-layers-overlays label')].map(l => l.textContent)"
        )
    )


def test_more_flights_than_colours_begin_anew_with_dashes() -> None:
    styles = [plots.flight_style(number) for number in range(2 * plots.FIGURES.flight_colors)]
    assert len(set(styles)) == len(styles)
    assert plots.flight_style(2 * plots.FIGURES.flight_colors) == styles[0]
    css = (Path(plots.__file__).parent / "page" / "report.css").read_text()
    assert all(f".line-{style}" in css for style in styles)


def rgb(color: str) -> tuple[int, ...]:
    return tuple(int(color[k : k + 2], 16) for k in (1, 3, 5))
