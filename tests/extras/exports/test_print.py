"""The print-out: a page for paper that needs nothing from elsewhere, with the map and heights of what is flown."""

import dataclasses
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from tests.missions.test_sorties import there_and_back
from tests.planner.sites import flat, hills, make_site
from tests.report.browser import chromium_or_skip
from uavcover.extras.exports.print_page import MAP_HEIGHT, MAP_WIDTH, clock, position_text, render_print
from uavcover.missions.flights import compile_sorties
from uavcover.missions.mission_compiler import Sortie
from uavcover.model.limits import NoFly
from uavcover.model.sensor import FrameCamera
from uavcover.scenario.airspace.zones import local_zones
from uavcover.scenario.site import Site

HOSTILE = '</title><script>alert("1")</script> & <b onload=x> "quoted"'


class Elements(HTMLParser):
    """Every element with its attributes, and all text; open elements must be closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in {"meta", "br"}:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(site: Site, flights: tuple[Sortie, ...], **notes: str) -> str:
    return render_print(
        site,
        flights,
        notes={"pilot": "", "contact": "", "weather": "", **notes},
        autopilot="ardupilot",
        coverage=0.984,
        plan_sha256="ab" * 32,
    )


def positions(path: str) -> np.ndarray:
    return np.array([[float(number) for number in position.split()] for position in path.removeprefix("M").split("L")])


@pytest.fixture(scope="module")
def split() -> tuple[Site, tuple[Sortie, ...]]:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    flights = compile_sorties(site, there_and_back(site, lines=6), autopilot="ardupilot")
    assert len(flights) > 1
    return site, flights


def test_it_needs_nothing_from_elsewhere_and_runs_nothing(split: tuple[Site, tuple[Sortie, ...]]) -> None:
    page = page_of(*split)
    elements = Elements(page)
    assert {tag for tag, _ in elements.found} & {"script", "img", "link", "iframe", "object", "use", "image"} == set()
    names = {name for _, attributes in elements.found for name in attributes}
    assert not [name for name in names if name.startswith("on") or name in {"href", "src", "style", "xlink:href"}]
    assert "url(" not in page
    assert "@import" not in page
    policy = next(a["content"] for tag, a in elements.found if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; style-src 'sha256-")


def drawn_lines(site: Site, flights: tuple[Sortie, ...], stroke_width: str) -> list[np.ndarray]:
    """Lines of one width on the page, one for each flight."""
    paths = [a for tag, a in Elements(page_of(site, flights)).found if tag == "path"]
    drawn = [positions(a["d"]) for a in paths if a.get("stroke-width") == stroke_width]
    assert len(drawn) == len(flights)
    return drawn


def test_the_map_is_true_to_scale(split: tuple[Site, tuple[Sortie, ...]]) -> None:
    """Every corner of every flight is on the map, turned and scaled by nothing but one factor, north up."""
    site, flights = split
    drawn = drawn_lines(site, flights, "1.5")
    factors = []
    for path, sortie in zip(drawn, flights, strict=True):
        route_m = sortie.compiled.path_m[:, :2]
        assert len(path) == len(route_m)
        assert path.min() >= 0.0
        assert (path.max(axis=0) <= [MAP_WIDTH, MAP_HEIGHT]).all()
        far = int(np.argmax(np.linalg.norm(route_m - route_m[0], axis=1)))
        factor = np.linalg.norm(path[far] - path[0]) / np.linalg.norm(route_m[far] - route_m[0])
        assert np.abs((path - path[0]) - (route_m - route_m[0]) * [factor, -factor]).max() < 0.25
        factors.append(factor)
    assert max(factors) / min(factors) < 1.002


def test_the_profile_keeps_heights_in_proportion(split: tuple[Site, tuple[Sortie, ...]]) -> None:
    site, flights = split
    drawn = drawn_lines(site, flights, "1.4")
    for path, sortie in zip(drawn, flights, strict=True):
        alts = site.alts_amsl_m(sortie.compiled.path_m)
        assert np.corrcoef(path[:, 1], alts)[0, 1] < -0.9999
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(sortie.compiled.path_m[:, :2], axis=0).T))])
        assert np.corrcoef(path[:, 0], along)[0, 1] > 0.9999


def test_the_band_is_drawn_over_the_ground(split: tuple[Site, tuple[Sortie, ...]]) -> None:
    site, flights = split
    found = Elements(page_of(site, flights)).found
    bands = [positions(a["d"]) for _, a in found if a.get("class") == "band"]
    assert len(bands) == 2 * len(flights)
    for low, high in zip(bands[::2], bands[1::2], strict=True):
        assert (low[:, 0] == high[:, 0]).all()
        assert np.ptp(low[:, 1] - high[:, 1]) < 0.21, "the same height apart everywhere"
        assert (low[:, 1] > high[:, 1]).all()


def test_flights_batteries_and_home_are_told(split: tuple[Site, tuple[Sortie, ...]]) -> None:
    site, flights = split
    text = Elements(page_of(site, flights)).text
    for sortie in flights:
        assert clock(sortie.compiled.flight_time_s) in text
        assert f"{sortie.first} to {sortie.last}" in text
    assert f"Flight batteries ({len(flights)}) and" in text
    assert "4:00" in text  # back by: 80 % of 300 s
    assert site.frame is not None
    assert site.home_m is not None
    lat, lon, _ = site.frame.geodetic_from_enu(site.home_m)
    assert position_text(float(lat[0]), float(lon[0])) in text
    safe = max(sortie.compiled.return_advice.safe_return_height_m for sortie in flights)
    reported = re.search(r"at least (\d+) m above home", text)
    assert reported is not None
    assert 0.0 <= int(reported.group(1)) - safe < 1.0
    for word in ("Pilot", "Emergency contact", "Weather window", "Before take-off", "40 to 120 m", "10 m/s"):
        assert word in text


def test_what_people_write_is_text() -> None:
    site = make_site(flat)
    zone = NoFly(polygon_east_north_m=((100.0, 50.0), (150.0, 50.0), (150.0, 90.0)), name=HOSTILE)
    zones = local_zones([zone], site.frame, site.area)
    scenario = dataclasses.replace(site.scenario, name=HOSTILE, description=HOSTILE)
    site = dataclasses.replace(site, scenario=scenario, zones=zones)
    flights = compile_sorties(make_site(flat), there_and_back(site, lines=2), autopilot="px4")
    page = page_of(site, flights, pilot=HOSTILE, contact=HOSTILE, weather=HOSTILE)
    elements = Elements(page)
    assert "script" not in {tag for tag, _ in elements.found}
    assert "b" not in {tag for tag, _ in elements.found}
    assert (
        elements.text.count(HOSTILE) >= 7
    )  # title, heading, description, three notes, the zone on the map and in the table


def test_empty_notes_are_lines_to_fill_in() -> None:
    site = make_site(flat)
    flights = compile_sorties(site, there_and_back(site), autopilot="ardupilot")
    count = page_of(site, flights).count('class="line"')
    assert page_of(site, flights, contact="112").count('class="line"') == count - 1


@pytest.mark.parametrize(
    ("sensor", "match"),
    [
        (FrameCamera(kind="frame-camera", fov_across_deg=70.0, fov_along_deg=50.0, range_m=300.0, pitch_deg=-60.0,
                     trigger_distance_m=17.0), "fixed, -60° .*, a photo every 17.0 m"),
        (FrameCamera(kind="frame-camera", fov_across_deg=70.0, fov_along_deg=50.0, range_m=300.0, heading_deg=5.0,
                     mount="stabilised", sensing="at-waypoints"), "stabilised, -90° .*, a photo at each waypoint"),
    ],
)  # fmt: skip
def test_the_camera_in_one_line(sensor: FrameCamera, match: str) -> None:
    site = make_site(flat, sensor=sensor)
    flights = compile_sorties(site, there_and_back(site), autopilot="ardupilot")
    assert re.search(match, Elements(page_of(site, flights)).text)


def test_places_of_all_hemispheres() -> None:
    assert position_text(-33.5, -70.25) == "33.500000° S, 70.250000° W"
    assert position_text(0.0, 179.9999999) == "0.000000° N, 180.000000° E"


@pytest.mark.parametrize(("seconds", "text"), [(0.0, "0:00"), (59.6, "1:00"), (3599.4, "59:59"), (4000.0, "66:40")])
def test_clock(seconds: float, text: str) -> None:
    assert clock(seconds) == text


def test_it_prints_on_a4(split: tuple[Site, tuple[Sortie, ...]], tmp_path: Path) -> None:
    program = chromium_or_skip()
    (tmp_path / "page.html").write_text(page_of(*split), encoding="utf-8")
    subprocess.run(
        [program, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={tmp_path}/b",
         f"--print-to-pdf={tmp_path}/page.pdf", (tmp_path / "page.html").as_uri()],
        check=True, capture_output=True, timeout=300,
    )  # fmt: skip
    printed = (tmp_path / "page.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox ?\[ ?0 0 ([0-9.]+) ([0-9.]+)\]", printed)
    assert 1 <= len(boxes) <= 4
    for width, height in boxes:
        assert float(width) == pytest.approx(595.0, abs=1.0)
        assert float(height) == pytest.approx(842.0, abs=1.0)
