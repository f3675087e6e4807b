"""A browser does the whole way as a pilot would: area, no-fly zone, plan, edit, export, upload, flight, verdict, gaps.

It skips where there is no Chromium. Nothing but the server on 127.0.0.1 is asked, and the page says no error.
"""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.extras.app.browser import opened
from tests.extras.app.conftest import Client
from uavcover.scenario.site import load_site

pytestmark = [pytest.mark.filterwarnings("ignore::DeprecationWarning"), pytest.mark.timeout(900)]
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>&lt;img src=x onerror=alert(1)&gt;</name><Polygon>
<outerBoundaryIs><LinearRing><coordinates>
-84.2160,36.4705 -84.2125,36.4705 -84.2125,36.4728 -84.2160,36.4728 -84.2160,36.4705
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>
"""


def test_the_whole_way(browser: Any, served: Client, cli: Any) -> None:
    data = Path(load_site.__code__.co_filename).parents[1] / "data" / "jacksboro.tif"
    (served.root / "dem.tif").write_bytes(data.read_bytes())
    p = opened(browser, served)
    page = p.page
    assert "token" not in page.url

    # An area by its file; what follows from the form is shown while it is filled in, and wrong values at their field.
    page.set_input_files("#f-files", files=[{"name": "field.kml", "mimeType": "text/xml", "buffer": KML.encode()}])
    p.until("window.uavcover.state.draft.area")
    page.select_option("#f-dem", "dem.tif")
    page.select_option("#f-vertical_datum", "EGM96")
    page.select_option("#f-camera", "dji-m3e")
    page.fill("#f-overlap", "40/30")
    page.fill("#f-gsd", "0")
    p.until("document.getElementById('f-gsd').getAttribute('aria-invalid') === 'true'")
    page.fill("#f-gsd", "4cm")
    p.until("window.uavcover.state.design?.flights?.[0].pictures > 20")
    assert "photos" in page.inner_text("#design")

    # A no-fly zone drawn on the map, taken back and drawn again.
    def corner(lon: float, lat: float, *, last: bool = False) -> None:
        page.mouse.move(*p.at(lon, lat))
        page.mouse.click(*p.at(lon, lat))
        page.wait_for_timeout(50 if last else 400)

    page.click("text=Draw no-fly zone")
    for lon, lat in ((-84.2152, 36.4712), (-84.2147, 36.4712), (-84.2147, 36.4716)):
        corner(lon, lat)
    page.keyboard.press("Enter")
    p.until("window.uavcover.state.draft.zones.length === 1")
    page.click("#undo")
    p.until("window.uavcover.state.draft.zones.length === 0")
    page.click("#redo")
    p.until("window.uavcover.state.draft.zones.length === 1")
    page.fill("#f-name", "field")
    page.click("#save")
    p.until("window.uavcover.state.name === 'field.toml' && window.uavcover.state.scene.zones.length === 1")

    # Plan, choose another route of the trade-off.
    page.select_option("#f-budget", "5s")
    page.click("#plan")
    p.until("window.uavcover.state.scene?.plan && window.uavcover.state.name === 'field'")
    members = p.until("window.uavcover.state.scene.members")
    if len(members) > 1:
        page.evaluate("() => { window.before = window.uavcover.state.scene; }")
        page.locator("circle.member").last.focus()
        page.keyboard.press("Enter")
        p.job_ended("select")
        p.until("window.uavcover.state.scene !== window.before")

    # A waypoint dragged far away: its legs are refused; taken back, they hold.
    page.click("#edit")
    p.until("window.uavcover.state.edit && !Number.isNaN(window.uavcover.state.edit.coverage)")
    lon, lat, _ = page.evaluate("() => window.uavcover.state.edit.points[1]")
    page.click("text=Show all")
    page.wait_for_timeout(500)
    x, y = p.at(lon, lat)
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 8):
        page.mouse.move(x + 70 * step, y - 20 * step)
    page.mouse.up()
    p.until("window.uavcover.state.edit.bad.length > 0")
    assert page.is_disabled("#save-edited")
    assert "violate a limit" in page.inner_text("#edit-state")
    page.click("#undo")
    p.until("window.uavcover.state.edit.bad.length === 0")
    page.click("text=Discard changes")
    p.until("!window.uavcover.state.edit")

    # Export, upload to a mock with read-back, fly, watch, verdict, gap mission.
    page.click("#export")
    p.job_ended("export")
    assert list(served.root.glob("field-plan*.plan"))
    page.click("#tab-fly")
    page.click("#upload")
    p.until("document.getElementById('uploaded')?.textContent.includes('has the uploaded mission')")
    page.fill("#f-mock", "40")
    page.click("#fly")
    p.until("window.uavcover.state.live.get('field')?.count > 20")
    p.until("document.getElementById('preflight')?.textContent.includes('climb speed')")
    assert page.is_visible("#back")
    p.until("window.uavcover.state.tab === 'judge' && document.getElementById('verdict')")
    page.click("#verify")
    p.job_ended("verify")
    assert "passed" in page.inner_text("#verdict"), p.messages()
    page.click("#gaps")
    p.job_ended("gaps")
    assert (served.root / "field" / "verification.json").is_file()

    # What was made here is what the commands make.
    again = cli("plan", served.root / "field.toml", "-o", served.root / "again", "--evaluations", "60", "--seed", "1")
    assert again.code in (0, 1), again.err
    assert "<img" not in page.content().replace("&lt;img", "")
    assert p.errors == []
    assert p.foreign == []


def test_a_fence_rally_points_and_several_vehicles(browser: Any, served: Client) -> None:
    data = Path(load_site.__code__.co_filename).parents[1] / "data" / "jacksboro.tif"
    (served.root / "dem.tif").write_bytes(data.read_bytes())
    p = opened(browser, served)
    page = p.page
    page.set_input_files("#f-files", files=[{"name": "field.kml", "mimeType": "text/xml", "buffer": KML.encode()}])
    p.until("window.uavcover.state.draft.area")
    for name, value in (("dem", "dem.tif"), ("vertical_datum", "EGM96"), ("camera", "dji-m3e")):
        page.select_option(f"#f-{name}", value)
    page.fill("#f-overlap", "40/30")
    page.fill("#f-gsd", "4cm")

    # A fence from a file, rally points typed; one outside is said at its field and taken back.
    fence = {
        "type": "Polygon",
        "coordinates": [[[-84.219, 36.468], [-84.21, 36.468], [-84.21, 36.475], [-84.219, 36.475]]],
    }
    fence["coordinates"][0].append(fence["coordinates"][0][0])
    (served.root / "fence.geojson").write_text(json.dumps(fence))
    page.set_input_files("#f-files", files=[{"name": "other.kml", "mimeType": "text/xml", "buffer": KML.encode()}])
    p.until("[...document.querySelectorAll('#f-fence option')].some(o => o.value === 'fence.geojson')")
    page.select_option("#f-fence", "fence.geojson")
    p.until("window.uavcover.state.draft.fence")
    page.click("text=Move corners")
    assert "fence" in page.evaluate("() => window.uavcover.map.draw.getSnapshot().map((each) => each.properties.of)")
    page.keyboard.press("Escape")
    zone = {"name": "tower", "geometry": fence, "floor_agl_m": "", "ceiling_agl_m": ""}
    page.evaluate("(zone) => { window.uavcover.state.draft.zones.push(zone); window.uavcover.state.redraw(); }", zone)
    assert "[object" not in page.inner_text("body")
    page.evaluate("() => { window.uavcover.state.draft.zones.pop(); window.uavcover.state.redraw(); }")

    # What is typed stays when the page is drawn anew.
    page.fill("#f-position", "36.47")
    page.evaluate("() => window.uavcover.state.redraw()")
    assert page.input_value("#f-position") == "36.47"
    for position in ("36.4712, -84.2170", "36.6, -84.2"):
        page.fill("#f-position", position)
        page.click("text=Add rally point at this position")
    p.until("document.getElementById('e-rally').textContent.includes('outside')")
    page.click("#undo")
    p.until("window.uavcover.state.draft.rally.length === 1")
    p.until("document.getElementById('e-rally').textContent === '' && window.uavcover.state.design?.flights")
    page.fill("#f-name", "fenced")
    page.click("#save")
    p.until("window.uavcover.state.scene?.rally.length === 1")
    scenario = load_site(str(served.root / "fenced.toml")).scenario
    assert scenario.planner.rally == ((-84.217, 36.4712),)
    assert len(scenario.limits.fence_lon_lat_deg or ()) == 4

    # Two vehicles: planned, checked, flown by one command, and seen both.
    page.select_option("#f-budget", "5s")
    page.fill("#f-vehicles", "2")
    page.click("#plan")
    p.until("window.uavcover.state.scene?.plan && window.uavcover.state.name === 'fenced'")
    vehicles = page.evaluate("() => window.uavcover.state.scene.plan.fleet.by_vehicle.length")
    page.click("#tab-fly")
    page.click("#upload")
    p.until("document.getElementById('uploaded')?.textContent.includes('has the uploaded mission')")
    page.click("#check")
    p.job_ended("check")
    p.until("document.getElementById('preflight')?.textContent.includes('Check the mission')")
    page.fill("#f-mock", "40")
    page.click("#fly")
    p.until(f"window.uavcover.state.live.size === {vehicles}")
    assert page.is_visible("#hold")
    assert page.is_visible("#back")
    assert page.is_visible("#leave")
    p.until("window.uavcover.state.tab === 'judge' && document.getElementById('verdict')")
    assert [track["name"] for track in page.evaluate("() => window.uavcover.state.scene.tracks")] != []

    # Photos without positions are no evidence: the command says so, and the page stays.
    page.set_input_files(
        "#f-photos", files=[{"name": "a.jpg", "mimeType": "image/jpeg", "buffer": b"\xff\xd8\xff\xd9"}]
    )
    p.job_ended("photos")
    assert (served.root / "fenced" / "photos" / "a.jpg").is_file()
    assert [error for error in p.errors if "400" not in error] == []
    assert p.foreign == []


def test_two_pages_that_edit_at_once_replace_nothing_of_each_other(browser: Any, served: Client, planned: Path) -> None:
    shutil.copytree(planned, served.root / "run")
    pages = [opened(browser, served) for _ in range(2)]
    for p in pages:
        p.page.select_option("#f-open", "run")
        p.until("window.uavcover.state.scene?.plan")
        p.page.click("#tab-plan")
        p.page.click("#edit")
        p.until("window.uavcover.state.edit && !Number.isNaN(window.uavcover.state.edit.coverage)")
    before = (served.root / "run" / "plan.json").read_bytes()
    for p in pages:
        p.page.click("text=Delete")
        p.until("document.getElementById('save-edited') && !document.getElementById('save-edited').disabled")
        p.page.click("#save-edited")
    for p in pages:
        p.job_ended("edit", 2)
    assert (served.root / "run" / "plan.json").read_bytes() == before
    made = [path.name for path in served.root.glob("run-edited*")]
    ended = pages[0].page.evaluate("() => [...window.uavcover.state.jobs.values()].map(j => [j.kind, j.run, j.code])")
    runs = [run for kind, run, _ in ended if kind == "edit"]
    assert len(set(runs)) == 2, "each page writes a folder of its own"
    assert set(made) <= set(runs)


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1180, 820), (2560, 1300)])
def test_sizes_themes_and_labels(browser: Any, served: Client, width: int, height: int) -> None:
    p = opened(browser, served, width, height)
    page = p.page
    page.select_option("#f-open", "valley.toml")
    p.until("window.uavcover.state.scene")
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    page.click("#theme")
    assert page.evaluate("() => getComputedStyle(document.body).backgroundColor !== 'rgb(255, 255, 255)'")
    nameless = page.evaluate(
        "() => [...document.querySelectorAll('#panel :is(button, input, select), header button, #tools :is(button, select)')]"
        ".filter(e => !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).map(e => e.outerHTML)"
    )
    assert nameless == []
    assert p.errors == []


def test_the_keyboard_alone_opens_a_scenario_and_its_plan_step(browser: Any, served: Client) -> None:
    p = opened(browser, served)
    page = p.page
    page.focus("#f-open")
    page.keyboard.type("vall")
    page.keyboard.press("Enter")
    p.until("window.uavcover.state.scene")
    page.focus("#tab-plan")
    page.keyboard.press("Enter")
    p.until("window.uavcover.state.tab === 'plan'")
    assert page.locator("#plan").count() == 1
    assert p.errors == []


def test_the_page_is_light(served: Client) -> None:
    status, _, page = served.ask("GET", f"/?token={served.token}")
    assert status == 200
    names = {
        "/page/app.js",
        "/page/map.js",
        "/page/dom.js",
        "/page/charts.js",
        "/page/strings.js",
        "/page/style.css",
        "/page/core.js",
        "/page/area.js",
        "/page/plan.js",
        "/page/fly.js",
        "/page/judge.js",
    }
    names |= set(re.findall(r'(?:href|src)="(/[^"]+)"', page.decode()))
    names |= {"/vendor/maplibre-gl/maplibre-gl.mjs", "/vendor/maplibre-gl/maplibre-gl-worker.mjs"}
    names |= {"/vendor/terra-draw/terra-draw.module.js", "/vendor/terra-draw/terra-draw-maplibre-gl-adapter.module.js"}
    sizes = {name: len(served.ask("GET", name)[2]) for name in names}
    assert all(sizes.values())
    assert sum(sizes.values()) < 3_000_000, json.dumps(sizes)
