"""How the page is used: by finger, by keyboard alone, with a connection that breaks, and while things change under it."""

import io
import json
import os
import re
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.extras.app.browser import Page, opened
from tests.extras.app.conftest import Client
from tests.extras.app.steps import SIZES
from uavcover.extras.app.server import PAGE
from uavcover.flight.flight_log import LIVE_LINE

pytestmark = [pytest.mark.filterwarnings("ignore::DeprecationWarning"), pytest.mark.timeout(900)]
SQUARE = ((-84.2160, 36.4705), (-84.2125, 36.4705), (-84.2125, 36.4728), (-84.2160, 36.4728))
TYPED_POSITIONS = ("36.4705, -84.2160", "36°28'13.8\"N 84°12'45\"W", "16S 750068 4040102")
DRAFT = "window.uavcover.state.draft"


def test_every_text_of_the_page_is_in_one_file() -> None:
    own = (PAGE / "strings.js").read_text()
    texts = set(re.findall(r'[{,\s]"?([A-Za-z0-9_-]+(?: [a-z]+)?)"?: "', own))
    others = {path.name: path.read_text() for path in PAGE.glob("*.js") if path.name != "strings.js"}
    others["index.html"] = (PAGE / "index.html").read_text()
    everything = "\n".join(others.values())
    requested = set(re.findall(r'\bt\("([^"]+)"\)', everything)) | set(
        re.findall(r'data-(?:text|label)="([^"]+)"', everything)
    )
    assert requested - texts == set(), "asked for, and not there"
    made = ("tab", "sensor_", "format_", "list_", "mark_", "ended", "not proved")
    unused = {key for key in texts if not key.startswith(made) and f'"{key}"' not in everything}
    assert unused == set(), "there, and never asked for"
    for name, text in others.items():
        code = re.sub(r"//.*|`[^`]*`", "", text) if name.endswith(".js") else ""
        said = [
            found
            for found in re.findall(r'"([^"\n]*)"', code)
            if re.search(r"[A-Z][a-z]+ [a-z]+|[a-z]{3,} [a-z]{3,} [a-z]{3,}", found)
        ]
        assert [found for found in said if "|" not in found] == [], f"{name}: a text outside of strings.js"


def test_an_area_is_drawn_with_the_keyboard_alone(browser: Any, served: Client) -> None:
    p = opened(browser, served)
    page, keys = p.page, p.page.keyboard

    def press(selector: str) -> None:
        page.focus(selector)
        keys.press("Enter")

    # Typed corners are exact, in any form of positions.
    press("button:text-is('Draw area')")
    for number, position in enumerate(TYPED_POSITIONS, 1):
        page.focus("#f-position")
        keys.press("Control+A")
        keys.type(position)
        press("#corner")
        p.until(f"window.uavcover.state.corners.length === {number}")
    press("#finish")
    p.until(f"{DRAFT}.area")
    ring = page.evaluate(f"() => {DRAFT}.area.coordinates[0][0]")
    assert ring[0] == [-84.216, 36.4705] == ring[-1]
    assert ring[1] == pytest.approx([-84.2125, 36.4705], abs=1e-9)
    # Corners at the cross: the map moves under it.
    press("button:text-is('Draw hole')")
    for move in ("ArrowRight", "ArrowUp", "ArrowLeft"):
        keys.press(" ")
        keys.press(move)
        page.wait_for_timeout(700)  # the map glides
    keys.press("Escape")
    assert page.evaluate("() => window.uavcover.state.corners") is None
    assert page.locator("#corner").count() == 0
    press("button:text-is('Draw no-fly zone')")
    for move in ("ArrowRight", "ArrowUp", "ArrowLeft"):
        keys.press(" ")
        keys.press(move)
        page.wait_for_timeout(700)
    keys.press("Enter")
    p.until(f"{DRAFT}.zones.length === 1")
    corners = page.evaluate(f"() => {DRAFT}.zones[0].geometry.coordinates[0]")
    assert len({tuple(corner) for corner in corners}) == 3
    keys.press("Control+z")
    p.until(f"{DRAFT}.zones.length === 0")
    assert p.errors == []


def test_an_area_is_drawn_and_a_waypoint_dragged_by_finger(browser: Any, served: Client, planned: Path) -> None:
    shutil.copytree(planned, served.root / "run")
    p = opened(browser, served, 820, 1180, has_touch=True)
    page = p.page
    page.evaluate("() => window.uavcover.map.map.jumpTo({ center: [-84.2142, 36.4716], zoom: 15.5 })")
    page.tap("button:text-is('Draw area')")
    for lon, lat in SQUARE:
        page.touchscreen.tap(*p.at(lon, lat))
        page.wait_for_timeout(400)
    page.tap("#finish")
    p.until(f"{DRAFT}.area")
    ring = page.evaluate(f"() => {DRAFT}.area.coordinates[0][0]")
    assert len(ring) == 5
    assert (
        max(abs(a - b) for corner, drawn in zip(SQUARE, ring, strict=False) for a, b in zip(corner, drawn, strict=True))
        < 2e-5
    )
    small = page.evaluate(
        "() => [...document.querySelectorAll('#panel button, #tools button, #tabs button, #panel select')]"
        ".filter(e => e.getBoundingClientRect().height < 43.5).map(e => e.textContent)"
    )
    assert small == [], "too small for a finger"

    page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene?.plan")
    page.tap("#tab-plan")
    page.tap("#edit")
    p.until("window.uavcover.state.edit && !Number.isNaN(window.uavcover.state.edit.coverage)")
    before = page.evaluate("() => window.uavcover.state.edit.points")
    x, y = p.at(*before[2][:2])
    touch = page.context.new_cdp_session(page)

    def send(kind: str, *points: tuple[float, float]) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": a, "y": b} for a, b in points]})

    send("touchStart", (x, y))
    covered = page.evaluate("() => window.uavcover.state.edit.coverage")
    for step in range(1, 6):
        send("touchMove", (x + 12 * step, y))
    p.until(f"window.uavcover.state.edit.coverage !== {covered}")  # coverage follows while the finger is down
    assert page.evaluate("() => window.uavcover.state.edit.past.length") == 0
    send("touchEnd")
    p.until("window.uavcover.state.edit.past.length === 1")
    after = page.evaluate("() => window.uavcover.state.edit.points")
    assert [n for n, point in enumerate(after) if point != before[n]] == [2]
    assert p.errors == []


def test_a_connection_that_breaks_loses_nothing(browser: Any, served: Client, flown: Path) -> None:
    """Sockets are cut while the track, its line and the news of a job grow; the page has each sample once, in order."""
    shutil.copytree(flown, served.root / "run")
    track = served.root / "run" / "track.csv"
    lines = track.read_bytes().splitlines(keepends=True)
    head = next(number for number, line in enumerate(lines) if not line.startswith(b"#")) + 1
    track.write_bytes(b"".join(lines[: head + 5]))
    p = opened(browser, served)
    page = p.page
    page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene")
    page.evaluate("() => window.uavcover.watch('run')")
    at = head + 5
    for end in range(at + 40, at + 200, 40):
        p.until("window.uavcover.map.tracks.get('run')?.points.length > 0")
        page.evaluate("() => window.sockets.at(-1).close()")
        with track.open("ab") as file:
            file.writelines(lines[at:end])
        at = end
        p.until(f"window.uavcover.map.tracks.get('run').points.length === {end - head}")
    assert page.evaluate("() => window.sockets.length") >= 5
    times = page.evaluate("() => window.uavcover.map.tracks.get('run').points.map((point) => point[3])")
    column = lines[head - 1].decode().strip().split(",").index("time_s")
    assert times == pytest.approx([float(line.split(b",")[column]) for line in lines[head:at]], abs=1e-6)
    p.until("document.getElementById('link').textContent === ''")


def test_a_flight_of_another_program_is_shown_with_battery_link_alarm_and_time_left(
    browser: Any, served: Client, flown: Path
) -> None:
    shutil.copytree(flown, served.root / "run")
    p = opened(browser, served)
    p.page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene")
    assert p.page.is_hidden("#orders")
    p.page.evaluate("() => window.uavcover.watch('run')")
    line = "mission, waypoint 3 of 9, 61 m AGL, 8.0 m/s, battery 55 %, link 97 %, home 40 m, covered 31 %, 3:10 left"
    file = served.root / "run" / LIVE_LINE
    file.write_text(json.dumps({"line": line, "warning": "\x1b[2J<img src=x onerror=alert(1)> GPS glitch"}))
    p.until("document.querySelector('#orders .warn')")
    shown = p.page.inner_text("#orders")
    assert line in shown
    assert "?[2J<img src=x onerror=alert(1)> GPS glitch" in shown
    assert "Another program controls this flight" in shown
    assert p.page.locator("#orders button").count() == 0
    file.write_text('{"line": ')  # half written
    p.page.wait_for_timeout(500)
    assert line in p.page.inner_text("#orders")
    file.unlink()
    p.until("document.getElementById('orders').hidden")
    assert p.errors == []


def test_what_is_typed_survives_that_the_panel_is_drawn_anew(browser: Any, served: Client, planned: Path) -> None:
    """In every field of every step, also in tables: value, focus and caret."""
    shutil.copytree(planned, served.root / "run")
    p = opened(browser, served)
    p.page.evaluate(
        "(ring) => { const zone = { name: 'a', geometry: { type: 'Polygon', coordinates: [ring] } };"
        " Object.assign(window.uavcover.state.draft, { zones: [zone], home: ring[0], rally: [ring[1]] });"
        " window.uavcover.state.redraw(); }",
        [*SQUARE, SQUARE[0]],
    )
    assert kept(p) >= 15
    p.page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene?.plan")
    p.page.click("#tab-plan")
    p.page.click("#edit")
    p.until("window.uavcover.state.edit")
    assert kept(p) >= 3 * p.page.evaluate("() => window.uavcover.state.edit.points.length")
    p.page.click("#tab-fly")
    assert kept(p) >= 2
    # A value that the page itself changed is shown, not what stood there before.
    p.page.click("#tab-area")
    p.page.click("text=New survey")
    p.page.evaluate("() => { window.uavcover.state.draft.rally = [[8.5, 47.5]]; window.uavcover.state.redraw(); }")
    p.page.locator("#points input").first.fill("47.25")
    p.page.evaluate("() => { window.uavcover.state.draft.rally[0][1] = 46; window.uavcover.state.redraw(); }")
    assert p.page.locator("#points input").first.input_value() == "46.000000"


def kept(p: Page) -> int:
    """The number of fields; each is typed into without leaving it, and the panel drawn anew."""
    fields = p.page.locator("#panel input:not([type=file]):not([type=checkbox])")
    for number in range(fields.count()):
        field = fields.nth(number)
        field.focus()
        field.evaluate(
            "(e) => { e.value += '7'; if (e.type === 'text') e.setSelectionRange(1, 1);"
            " window.uavcover.state.redraw(); }"
        )
        again = fields.nth(number)
        assert again.input_value().endswith("7"), again.evaluate("(e) => e.outerHTML")
        assert again.evaluate("(e) => e === document.activeElement && (e.type !== 'text' || e.selectionStart === 1)")
    return fields.count()


def test_maps_of_the_user_are_the_background(browser: Any, served: Client) -> None:
    """A GeoTIFF and an MBTiles file, each asked for tiles and drawn below the shapes."""
    image = io.BytesIO()
    Image.new("RGB", (256, 256), (200, 30, 30)).save(image, "PNG")
    with sqlite3.connect(served.root / "map.mbtiles") as connection:
        connection.execute("create table tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        tiles = [(z, x, y, image.getvalue()) for z in range(4) for x in range(2**z) for y in range(2**z)]
        connection.executemany("insert into tiles values (?, ?, ?, ?)", tiles)
    connection.close()
    shutil.copy(PAGE.parents[2] / "data" / "jacksboro.tif", served.root / "photo.tif")
    p = opened(browser, served)
    answers: list[tuple[str, int]] = []
    p.page.on("response", lambda answer: answers.append((answer.url.partition("?")[2], answer.status)))
    p.page.evaluate("() => window.uavcover.map.map.jumpTo({ center: [-84.2, 36.47], zoom: 1 })")
    for name in ("map.mbtiles", "photo.tif"):
        if name == "photo.tif":
            p.page.evaluate("() => window.uavcover.map.map.jumpTo({ zoom: 11 })")
        # The layer of the file before stands until the first tile of this one is asked for.
        with p.page.expect_response(lambda answer, requested=f"file={name}": requested in answer.url):
            p.page.select_option("#tools select[aria-label='Background']", name)
        p.until("window.uavcover.map.map.getLayer('background') && window.uavcover.map.map.areTilesLoaded()")
        assert (f"file={name}", 200) in answers
    order = p.page.evaluate("() => window.uavcover.map.map.getStyle().layers.map((layer) => layer.id)")
    assert order.index("background") < order.index("area")
    p.page.select_option("#tools select[aria-label='Background']", "")
    p.until("!window.uavcover.map.map.getLayer('background')")
    assert p.errors == []


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_axe_finds_nothing_serious_at_any_step(
    browser: Any, served: Client, flown: Path, size: tuple[int, int], theme: str
) -> None:
    """axe-core judges contrast, names, roles and focus; it is no package of ours, so its file is named."""
    file = os.environ.get("UAVCOVER_AXE", "")
    if not Path(file).is_file():
        pytest.skip("UAVCOVER_AXE names no axe.min.js (npm package axe-core)")
    shutil.copytree(flown, served.root / "run")
    p = opened(browser, served, *size, color_scheme=theme)
    p.page.evaluate(Path(file).read_text() + ";0")
    found: list[Any] = []

    def judge(step: str) -> None:
        ask = (
            "async () => (await window.axe.run()).violations.map(v => [v.impact, v.id, v.nodes[0].html.slice(0, 200)])"
        )
        found.extend([step, *each] for each in p.page.evaluate(ask) if each[0] in ("serious", "critical"))

    judge("area")
    p.page.evaluate("() => window.uavcover.loadArea('valley.geojson')")
    p.until(f"{DRAFT}.area")
    p.page.evaluate("() => { window.uavcover.state.draft.home = [-84.209, 36.4738]; window.uavcover.state.redraw(); }")
    judge("drawn")
    p.page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene?.plan")
    for tab in ("plan", "fly", "judge"):
        p.page.click(f"#tab-{tab}")
        judge(tab)
    p.page.click("#tab-plan")
    if p.page.is_enabled("#edit"):
        p.page.click("#edit")
        p.until("window.uavcover.state.edit && !Number.isNaN(window.uavcover.state.edit.coverage)")
        judge("edit")
    (served.root / "run" / LIVE_LINE).write_text(json.dumps({"line": "mission, 61 m AGL", "warning": "GPS glitch"}))
    p.page.evaluate("() => window.uavcover.watch('run')")
    p.until("document.querySelector('#orders .warn')")
    judge("flying")
    assert p.page.evaluate("async () => (await window.axe.run()).passes.length") > 10, "it looked"
    assert found == []
