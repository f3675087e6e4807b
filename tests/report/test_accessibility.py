"""axe-core over the page: no serious or critical finding, on a screen and on a phone, in light and dark.

axe-core (MPL-2.0) is no part of this repository. Where UAVCOVER_AXE names its ``axe.min.js``, such as that of ``npm install
axe-core``, the test runs; else it skips.
"""

import dataclasses
import itertools
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.recording.flights import lines_over
from tests.report.browser import Page
from tests.report.conftest import resumed, two_sorties, write_run
from tests.report.test_report_of_photos import CAMERA
from uavcover.report import page as page_module
from uavcover.report.content import ReportContent, read_run
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site, load_site


def planned_only(folder: Path, site: Site) -> RunFolder:
    return write_run(folder, site, lines_over(site, spacing_m=300.0, count=2), flown=False)


def with_photos(folder: Path, site: Site) -> RunFolder:
    pictured = load_site(dataclasses.replace(site.scenario, sensor=CAMERA))
    return write_run(folder, pictured, lines_over(pictured, spacing_m=90.0, count=2), flown=True)


RUNS: dict[str, Callable[[Path, Site], RunFolder]] = {
    "sorties": two_sorties, "resumed": resumed, "planned": planned_only, "pictures": with_photos,
}  # fmt: skip


def axe_source() -> str:
    named = os.environ.get("UAVCOVER_AXE")
    if not named:
        pytest.skip("UAVCOVER_AXE does not name axe.min.js (npm install axe-core)")
    return Path(named).read_text(encoding="utf-8")


def findings(page: Page, source: str) -> list[dict[str, Any]]:
    page.run(f"void (() => {{ {source} }})()")
    found = page.run(
        "axe.run(document, { resultTypes: ['violations'] }).then(r => r.violations.map(v =>"
        " ({ id: v.id, impact: v.impact, help: v.help, nodes: v.nodes.map(n => n.html.slice(0, 120)) })))"
    )
    assert isinstance(found, list)
    return found


@pytest.mark.parametrize("which", ["one", *RUNS])
@pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
@pytest.mark.parametrize("colors", ["light", "dark"])
def test_axe_finds_nothing_serious(
    page: Page, site: Site, content: ReportContent, tmp_path: Path, which: str, size: tuple[int, int], colors: str
) -> None:
    source = axe_source()
    shown = content if which == "one" else read_run(RUNS[which](tmp_path / "run", site), logs=())
    path = tmp_path / "report.html"
    path.write_text(render_report(shown))
    page.open(path, width=size[0], height=size[1], colors=colors)
    page.run("document.querySelectorAll('details').forEach(d => { d.open = true })")
    serious = [finding for finding in findings(page, source) if finding["impact"] in {"serious", "critical"}]
    assert serious == []


def test_axe_sees_harm(page: Page, html: str, tmp_path: Path) -> None:
    source = axe_source()
    path = tmp_path / "report.html"
    path.write_text(html)
    page.open(path, width=1400)
    page.run("document.querySelector('.kicker').style.color = '#dddddd'")
    page.run("document.querySelector('.chart > svg').removeAttribute('aria-label')")
    assert {"color-contrast", "svg-img-alt"} <= {finding["id"] for finding in findings(page, source)}


def test_text_has_contrast_in_light_and_dark() -> None:
    """What axe cannot decide, in charts and over pictures: WCAG's contrast of the style sheet's own colours, at least 4.5."""
    style = (Path(page_module.__file__).parent / "page" / "report.css").read_text(encoding="utf-8")
    schemes = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    assert len(schemes) == 3
    for scheme in schemes:
        colors = dict(re.findall(r"--([\w-]+): (#\w{3}(?:\w{3})?)[;\s]", scheme))
        for text, behind in itertools.product(("ink", "quiet", "yes", "no"), ("paper", "panel")):
            assert contrast(colors[text], colors[behind]) >= 4.5, (text, behind, scheme)


def contrast(one: str, other: str) -> float:
    """WCAG 2: (lighter + 0.05) / (darker + 0.05) of relative luminances."""
    shades = sorted(_luminance(color) for color in (one, other))
    return (shades[1] + 0.05) / (shades[0] + 0.05)


def _luminance(color: str) -> float:
    digits = color[1:] if len(color) == 7 else "".join(2 * digit for digit in color[1:])
    parts = [int(digits[k : k + 2], 16) / 255.0 for k in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
