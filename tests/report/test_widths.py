"""The page at the widths of phones and screens: nothing is cut, charts fit, planned and flown are told apart."""

import base64
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.report.browser import Page
from tests.report.conftest import resumed, two_sorties, write_run
from tests.report.test_in_browser import check_quiet
from uavcover.model.route import Route
from uavcover.report.content import read_run
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site

WIDTHS = (320, 390, 640, 641, 900, 1400)
_SETTLE = "new Promise(done => setTimeout(done, 250))"

_SHOWN = "[...document.querySelectorAll('.chart > svg')].filter(s => getComputedStyle(s).display !== 'none')"
_CUT_TEXT = f"""{_SHOWN}.flatMap(s => {{ const outer = s.getBoundingClientRect();
    return [...s.querySelectorAll('text')].filter(t => {{ const b = t.getBoundingClientRect();
        return b.left < outer.left - 1 || b.right > outer.right + 1 || b.top < outer.top - 1 || b.bottom > outer.bottom + 1 }})
    .map(t => t.textContent) }})"""
_SMALLEST_TEXT = f"""Math.min(...{_SHOWN}.flatMap(s => [...s.querySelectorAll('text')].map(t =>
    parseFloat(getComputedStyle(t).fontSize) * s.getBoundingClientRect().width / s.viewBox.baseVal.width)))"""
# Anything wider than the screen that no scrolling or clipping box holds.
_TOO_WIDE = """[...document.body.querySelectorAll('*')].filter(e => !e.closest('#map') && !e.closest('thead')
    && e.getBoundingClientRect().right > document.documentElement.clientWidth + 1).map(e => e.outerHTML.slice(0, 80))"""
_OVERLAPPING_TICKS = f"""{_SHOWN}.flatMap(s => {{
    const boxes = [...s.querySelectorAll('text.tick')].map(t => t.getBoundingClientRect());
    return boxes.flatMap((a, i) => boxes.slice(i + 1).filter(b =>
        a.left < b.right && b.left < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom)) }}).length"""


@pytest.fixture(scope="module", params=["one", "sorties", "resumed"])
def kind(request: pytest.FixtureRequest, site: Site, run: RunFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of one flight, of two sorties, of a resumed flight."""
    folder = tmp_path_factory.mktemp("widths")
    make: dict[str, Callable[[Path, Site], RunFolder]] = {"sorties": two_sorties, "resumed": resumed}
    made = make[request.param](folder / "run", site) if request.param in make else run
    path = folder / "report.html"
    path.write_text(render_report(read_run(made, logs=())))
    return path


def test_nothing_is_cut_at_any_width(page: Page, kind: Path) -> None:
    page.open(kind, width=WIDTHS[0], height=844)
    page.run("document.querySelectorAll('details').forEach(d => { d.open = true })")
    for width in WIDTHS:
        page.look(width=width, height=844)
        page.run(_SETTLE)
        assert page.run("document.documentElement.scrollWidth") <= width
        assert page.run(_TOO_WIDE) == [], width
        assert page.run(f"{_SHOWN}.length") == page.run("document.querySelectorAll('.chart').length")
        narrow = page.run(f"{_SHOWN}.every(s => s.classList.contains('frame-narrow'))")
        assert narrow == (width <= 640)
        assert page.run(_CUT_TEXT) == [], width
        assert page.run(_SMALLEST_TEXT) >= 9.5, width
        assert page.run(_OVERLAPPING_TICKS) == 0, width
    check_quiet(page)


def test_tables_are_cards_on_a_phone(page: Page, kind: Path) -> None:
    page.open(kind, width=390, height=844)
    cells = page.run("[...document.querySelectorAll('.cards tbody td')].map(c => c.getBoundingClientRect().right)")
    assert cells
    assert max(cells) <= 390
    unnamed = page.run(
        "[...document.querySelectorAll('.cards tbody td')].filter(c =>"
        " ['none', '\"\"'].includes(getComputedStyle(c, '::before').content)).map(c => c.outerHTML)"
    )
    assert unnamed == []
    page.look(width=1200, height=900)
    assert page.run("getComputedStyle(document.querySelector('.cards thead')).display") == "table-header-group"


def test_planned_lies_broad_under_what_was_flown(page: Page, kind: Path) -> None:
    page.open(kind, width=1200)
    order = page.run(
        "[...document.querySelectorAll('#map path.planned, #map path.track')].map(p =>"
        " [p.classList.contains('track'), parseFloat(p.getAttribute('stroke-width'))])"
    )
    flown = [is_track for is_track, _ in order]
    assert flown == sorted(flown)
    assert any(flown)
    assert min(width for is_track, width in order if not is_track) > max(width for is_track, width in order if is_track)
    for chart in ("profile", "along"):
        lines = page.run(
            f"[...document.querySelectorAll('#chart-{chart} .frame-wide path')]"
            ".filter(p => /^line-(planned|flight)/.test(p.className.baseVal))"
            ".map(p => [p.className.baseVal, parseFloat(getComputedStyle(p).strokeWidth)])"
        )
        assert lines[0][0] == "line-planned"
        assert all(name.startswith("line-flight") and width < 0.5 * lines[0][1] for name, width in lines[1:])
    legend = page.run("[...document.querySelectorAll('#line-legend li')].map(l => l.textContent)")
    assert [words for words in legend if words.startswith("planned")]
    assert len([words for words in legend if words.startswith("flown")]) == flown.count(True)


def test_both_routes_show_in_three_dimensions(page: Page, kind: Path) -> None:
    page.open(kind, width=1200)
    page.run(_SETTLE)
    uri = page.run("document.querySelector('#view3d').toDataURL()")
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))).convert("RGB")).astype(int)
    white = (np.abs(drawn - 255).max(axis=2) < 50) & _near_dark(drawn)
    assert white.sum() > 300
    colors = page.run("data.tracks.map(t => report.trackLook(t).color)")
    for color in colors:
        rgb = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
        assert (np.abs(drawn - rgb).max(axis=2) < 40).sum() > 300, color


def _near_dark(photo: np.ndarray) -> np.ndarray:
    """(h, w) whether a pixel within three is dark or coloured, as the edge of a line is: leaves out the white background."""
    edge = photo.min(axis=2) < 120
    near = np.zeros_like(edge)
    for down in range(-3, 4):
        for right in range(-3, 4):
            near |= np.roll(edge, (down, right), axis=(0, 1))
    return near


def test_the_legend_names_every_sortie(page: Page, site: Site, tmp_path: Path) -> None:
    run = two_sorties(tmp_path / "run", site)
    path = tmp_path / "report.html"
    path.write_text(render_report(read_run(run, logs=())))
    page.open(path)
    legend = page.run("[...document.querySelectorAll('#line-legend li')].map(l => l.textContent)")
    assert {"planned, sortie 1", "planned, sortie 2", "flown, sortie-1/track.csv", "flown, sortie-2/track.csv"} <= {
        *legend
    }
    edges = page.run("[...document.querySelectorAll('#map path.planned')].map(p => p.getAttribute('stroke'))")
    flown = page.run("[...document.querySelectorAll('#map path.track')].map(p => p.getAttribute('stroke'))")
    # Each sortie's edge, and the white over it.
    assert edges == [flown[0], "#ffffff", flown[1], "#ffffff"]


def test_waypoints_are_thinned_by_zoom(page: Page, site: Site, tmp_path: Path) -> None:
    count = 900
    west, south, east, north = site.area.bounds
    along = np.linspace(0.0, 1.0, count)
    positions = np.column_stack(
        [west + (east - west) * along, south + (north - south) * (0.5 + 0.4 * np.sin(9.0 * along))]
    )
    route = Route(np.column_stack([positions, site.ground.heights_m(positions) + 80.0]))
    run = write_run(tmp_path / "run", site, route, flown=False)
    path = tmp_path / "report.html"
    path.write_text(render_report(read_run(run, logs=())))
    page.open(path, width=1000)
    numbers = (
        "[...document.querySelectorAll('#map .number')]"
        ".map(n => [Number(n.textContent), ...Object.values(L.DomUtil.getPosition(n))])"
    )
    dots = "[...document.querySelectorAll('#map path.waypoint')].length"
    first, few = page.run(numbers), page.run(dots)
    assert {0, count - 1} <= {int(number) for number, _, _ in first}
    at = np.array([[x, y] for _, x, y in first])
    distance = np.linalg.norm(at[:, None] - at, axis=2) + 1e9 * np.eye(len(at))
    assert distance.min() >= 26.0 - 1.5
    assert 5 < len(first) < few < count
    page.run("void report.map.setZoom(report.map.getZoom() + 2, { animate: false })")
    page.run(_SETTLE)
    assert len(page.run(numbers)) > 1.5 * len(first)
    assert page.run(dots) > 1.5 * few
    page.run("void report.map.setZoom(report.map.getZoom() - 2, { animate: false })")
    page.run(_SETTLE)
    assert page.run(dots) == few
    check_quiet(page)
