"""The page in a headless Chromium: nothing is complained about, nothing is asked for, everything can be switched."""

import base64
import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.recording.flights import lines_over
from tests.report.browser import Page
from tests.report.conftest import HOSTILE, coarse, write_run
from uavcover.report.content import read_run
from uavcover.report.page import render_report

_PATHS = "document.querySelectorAll('#map .leaflet-pane path').length"
_NUMBERS = "document.querySelectorAll('#map .number').length"
_CELLS = "document.querySelector('#map img.cells')?.src ?? null"
_LEGEND = "document.querySelector('#legend').textContent"
_PHOTO = "document.querySelector('#view3d').toDataURL()"
_SETTLE = "new Promise(done => setTimeout(done, 250))"


@pytest.fixture
def opened(page: Page, html: str, tmp_path: Path) -> Page:
    path = tmp_path / "report.html"
    path.write_text(html)
    page.open(path)
    return page


def check_quiet(page: Page) -> None:
    assert page.complaints == []
    assert [url for url in page.requests if not url.endswith("/report.html")] == []


def test_every_layer_can_be_switched(opened: Page) -> None:
    overlays = opened.run(
        "[...document.querySelectorAll('.leaflet-control-layers-overlays label')].map(l => l.textContent.trim())"
    )
    assert overlays[:5] == ["Area", "Fence", "Planned route", "Waypoint numbers", "Flown track"]
    assert any(name.startswith("Gaps (") for name in overlays)
    for number, name in enumerate(overlays):
        click = f"document.querySelectorAll('.leaflet-control-layers-overlays input')[{number}].click()"
        before = opened.run(f"[{_PATHS}, {_NUMBERS}]")
        opened.run(click)
        hidden = opened.run(f"[{_PATHS}, {_NUMBERS}]")
        assert sum(hidden) < sum(before), name
        opened.run(click)
        assert opened.run(f"[{_PATHS}, {_NUMBERS}]") == before, name
    photos, legends = set(), set()
    grounds = opened.run("document.querySelectorAll('.leaflet-control-layers-base input').length")
    for number in range(grounds):
        opened.run(f"document.querySelectorAll('.leaflet-control-layers-base input')[{number}].click()")
        photos.add(opened.run(_CELLS))
        legends.add(opened.run(_LEGEND))
    assert len(photos) == len(legends) == grounds == 7
    assert None in photos
    check_quiet(opened)


def test_the_3d_view_is_drawn_turns_and_follows_the_layer(opened: Page) -> None:
    first = opened.run(_PHOTO)
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(first.split(",")[1]))))
    assert (drawn[..., 3] > 0).mean() > 0.15
    opened.run("document.querySelectorAll('.leaflet-control-layers-base input')[2].click()")
    opened.run(_SETTLE)
    other_layer = opened.run(_PHOTO)
    opened.run("document.querySelector('#view3d').dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft'}))")
    opened.run(_SETTLE)
    turned = opened.run(_PHOTO)
    assert len({first, other_layer, turned}) == 3
    check_quiet(opened)


def test_popups_and_the_cursor_over_a_chart(opened: Page) -> None:
    opened.run(
        "document.querySelectorAll('#map path.waypoint')[3].dispatchEvent(new MouseEvent('click', {bubbles: true}))"
    )
    words = opened.run("document.querySelector('.leaflet-popup-content')?.textContent ?? ''")
    assert "waypoint 3" in words
    assert "m east" in words
    chart = "document.querySelector('[data-chart=\"height\"]')"
    opened.run(
        f"(() => {{ const b = {chart}.getBoundingClientRect(); {chart}.dispatchEvent(new PointerEvent('pointermove',"
        " {clientX: b.x + b.width / 2, clientY: b.y + 20})) })()"
    )
    assert "m above ground" in opened.run("document.querySelector('#chart-height output').textContent")
    check_quiet(opened)


def test_dark_phone_and_paper(opened: Page) -> None:
    background = "getComputedStyle(document.body).backgroundColor"
    light = opened.run(background)
    opened.look(colors="dark")
    dark = opened.run(background)
    assert sum(map(int, dark[4:-1].split(","))) < 150 < 600 < sum(map(int, light[4:-1].split(",")))
    opened.look(media="print", colors="dark")
    assert opened.run(background) == "rgb(255, 255, 255)"
    assert opened.print_pdf().startswith(b"%PDF")
    opened.look(width=360, height=740)
    opened.run(_SETTLE)
    assert opened.run("document.documentElement.scrollWidth") <= 360
    assert opened.run("document.querySelector('#map').getBoundingClientRect().width") > 300
    check_quiet(opened)


def test_hostile_names_do_not_run(page: Page, tmp_path: Path) -> None:
    site = coarse("jacksboro", 100.0, description=HOSTILE)
    run = write_run(tmp_path / "run", site, lines_over(site, spacing_m=300.0, count=2), flown=True, name=HOSTILE)
    plan = json.loads(run.file("plan.json").read_text())
    run.file("plan.json").write_text(
        json.dumps(plan | {"select": HOSTILE, "name": HOSTILE, "bounds": {HOSTILE: HOSTILE}})
    )
    path = tmp_path / "report.html"
    path.write_text(render_report(read_run(run, logs=())))
    page.open(path)
    assert page.run("window.hacked ?? null") is None
    assert page.run("document.querySelectorAll('img[src=x]').length") == 0
    assert page.run(_PATHS) > 0
    check_quiet(page)
