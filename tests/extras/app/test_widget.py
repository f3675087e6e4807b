"""The map of a notebook: in a page that does what a notebook does for anywidget, with no network at all."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uavcover
from tests.extras.app.browser import Page
from uavcover.errors import InputError
from uavcover.extras.app import widget
from uavcover.run.track_file import read_track

pytestmark = [pytest.mark.filterwarnings("ignore::DeprecationWarning"), pytest.mark.timeout(900)]
NOTEBOOK = "http://notebook.test/"
HOST = """async ([esm, css, values]) => {
    const style = document.createElement("style"), el = document.createElement("div"), heard = {};
    style.textContent = css;
    document.head.append(style);
    document.body.append(el);
    const model = { get: (name) => values[name], on: (name, call) => { heard[name] = call; } };
    const { default: { render } } = await import(URL.createObjectURL(new Blob([esm], { type: "text/javascript" })));
    window.ended = await render({ model, el });
    Object.assign(window, { el, change: (name, value) => { values[name] = value; heard[`change:${name}`](); } });
}"""


def shown(browser: Any, document: dict[str, Any]) -> Page:
    """A page with the widget, whose network is cut."""
    page = Page(browser.new_page(viewport={"width": 900, "height": 700}))
    page.page.route(
        re.compile("^http"),
        lambda route: (
            route.fulfill(status=200, content_type="text/html", body="<!doctype html><title>a notebook</title>")
            if route.request.url == NOTEBOOK
            else route.abort()
        ),
    )
    page.page.goto(NOTEBOOK)
    css = (Path(widget.__file__).parent / "vendor" / "maplibre-gl" / "maplibre-gl.css").read_text()
    document = json.loads(json.dumps(document, allow_nan=False))
    page.page.evaluate(HOST, [widget.module_text(), css, {"document": document, "height": "480px"}])
    page.until("el.dataset.ready === 'yes'")
    return page


def drawn(page: Page, layer: str) -> Any:
    return page.until(f"el.coverageMap.map.queryRenderedFeatures({{ layers: ['{layer}'] }}).length")


def test_plan_track_and_verdict_are_on_the_map_without_a_network(browser: Any, flown: Path) -> None:
    verdict = uavcover.verify(flown)
    track = read_track(flown / "track.csv")
    p = shown(browser, widget.document_of(flown))
    for layer in ("route", "area", "track", "contours", "path"):
        assert drawn(p, layer), layer
    p.until("el.coverageMap.canvas.width > 10")
    assert "observed" in p.page.inner_text("body")
    for thing, layers in ((track, ("track",)), (verdict, ("area", "fence", "contours"))):
        p.page.evaluate("(document) => window.change('document', document)", widget.document_of(thing))
        for layer in layers:
            assert drawn(p, layer), layer
    assert p.page.evaluate("() => el.coverageMap.map.queryRenderedFeatures({ layers: ['route'] }).length") == 0
    p.page.evaluate("() => window.ended()")
    assert p.foreign == [NOTEBOOK], "the notebook's own page, and no other address"
    assert p.errors == []


def test_a_name_with_markup_stays_text(browser: Any, flown: Path) -> None:
    hostile = "<img src=x onerror=alert(1)>"
    layers = [{"image": "", "legend": [{"color": "red;background:url(http://evil.example)", "label": hostile}]}]
    p = shown(browser, widget.document_of(read_track(flown / "track.csv")) | {"caption": hostile, "layers": layers})
    assert p.page.inner_text("body").count(hostile) == 2
    assert p.page.locator("img").count() == 0
    assert p.foreign == [NOTEBOOK]
    assert p.errors == []


def test_a_track_far_longer_than_a_screen_is_thinned(flown: Path) -> None:
    document = widget.document_of(read_track(flown / "track.csv"))
    line = np.array(document["tracks"][0]["line"])
    assert 100 < len(line) <= 4000
    assert (document["bounds"] == np.concatenate([line.min(axis=0), line.max(axis=0)])).all()


def test_a_plan_knows_its_folder_and_one_without_is_refused(tmp_path: Path) -> None:
    site = uavcover.load_site(str(Path(__file__).parents[3] / "docs" / "examples" / "valley.toml"))
    plan = uavcover.plan(site, out=tmp_path / "run", evaluations=60, seed=1)
    assert len(widget.document_of(plan)["route"]) == plan.chosen.metrics.waypoint_count
    chosen = uavcover.select(tmp_path / "run", "coverage>=0.5")
    assert chosen.folder == plan.folder
    with pytest.raises(InputError, match="was not saved to a run folder"):
        widget.document_of(dataclasses.replace(plan, folder=""))


def test_the_module_needs_no_other_one() -> None:
    text = widget.module_text()
    assert len(text) < 1_000_000
    assert re.findall(r"\bfrom\s*[\"']|import\s*[\"']|https?://", text) == []
    files = dict(widget.packed_files())
    for name, code in files.items():
        if name.startswith("/page/"):
            for requested in re.findall(r'from "([^"]+)"', code):
                assert list(files).index(requested) < list(files).index(name), (name, requested)


def test_a_notebook_shows_it_by_itself(flown: Path) -> None:
    pytest.importorskip("anywidget", reason="no anywidget; pip install 'uavcover[jupyter]'")
    formatting = pytest.importorskip("IPython.core.formatters")
    shell = type("Shell", (), {"display_formatter": formatting.DisplayFormatter()})()
    widget.load_ipython_extension(shell)
    bundle, _ = shell.display_formatter.format(read_track(flown / "track.csv"))
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert "svg" in bundle["text/html"], "where widgets cannot be shown, the picture"
    assert widget.show(flown).document["route"]
