"""The map of a checked mission: one file, what is broken in red, nothing from files as markup."""

import base64
import hashlib
import json
import re
from pathlib import Path

import pytest

from tests.extras.check.test_command import DEM, GOOD, mission
from tests.report.browser import Page
from tests.report.test_accessibility import axe_source, findings
from uavcover.cli.new import ElevationData
from uavcover.errors import InputError
from uavcover.extras.check.check_page import render_check_page
from uavcover.extras.check.mission_file import CheckQuery, check
from uavcover.extras.check.world import Limits
from uavcover.run.user import Unattended


def page_of(folder: Path, *rows: str, name: str = "m.waypoints", north_deg: int = 36, **more) -> tuple[str, dict]:
    file = mission(folder, *rows, name=name)
    file.write_text(file.read_text().replace("\t36.", f"\t{north_deg}."))
    query = CheckQuery(
        file=file,
        elevation=ElevationData(names=(str(DEM),)),
        return_height_m=70.0,
        limits=Limits(min_height_agl_m=10.0),
        **more,
    )
    text = render_check_page(query, check(query, Unattended()))
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found is not None
    return text, json.loads(found[1])


def zone(folder: Path, name: str) -> str:
    ring = [[-84.2155, 36.4765], [-84.2153, 36.4765], [-84.2153, 36.4775], [-84.2155, 36.4775], [-84.2155, 36.4765]]
    feature = {"type": "Feature", "properties": {"name": name}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    (folder / "zone.geojson").write_text(json.dumps(feature))
    return str(folder / "zone.geojson")


def test_broken_legs_zones_and_clearance(tmp_path: Path) -> None:
    text, data = page_of(tmp_path, *GOOD, no_fly=(zone(tmp_path, "Z"),))
    broken = {(leg["from"], leg["to"]) for leg in data["legs"] if leg["broken"]}
    assert (2, 3) in broken
    assert (0, 1) not in broken
    assert len(data["noFly"]) == 1
    assert data["fence"] == []
    assert {one["kind"] for one in data["findings"] if one["weight"] == "breaks"} == {"no-fly", "return-no-fly"}
    for leg in data["legs"]:
        above = [up - ground for up, ground in zip(leg["path"], leg["ground"], strict=True)]
        assert min(above) == pytest.approx(leg["clearance"], abs=1.0)
    assert text.count('class="no">exceeded') == sum(leg["broken"] for leg in data["legs"])
    good, clear = page_of(tmp_path, *GOOD)
    assert not any(leg["broken"] for leg in clear["legs"])
    assert "Passed" in good


def test_it_opens_offline_and_takes_nothing_from_files_as_markup(tmp_path: Path) -> None:
    text, _ = page_of(tmp_path, *GOOD, name="<b>m.waypoints", no_fly=(zone(tmp_path, "</script><script>alert(1)"),))
    assert "<b>m" not in text
    assert "<script>alert" not in text
    assert "http://" not in re.sub(r"https?://(www\.w3\.org|leafletjs|github)[^\s\"'<]*", "", text).split("<style>")[0]
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    for body in scripts:
        assert base64.b64encode(hashlib.sha256(body.encode()).digest()).decode() in policy[1].replace("&#39;", "'")


def test_a_mission_without_a_path_has_no_page(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no path"):
        page_of(tmp_path, *GOOD, north_deg=46)


@pytest.mark.parametrize("width", [320, 390, 1400])
def test_it_fits_its_screen(page: Page, tmp_path: Path, width: int) -> None:
    (tmp_path / "check.html").write_text(page_of(tmp_path, *GOOD, no_fly=(zone(tmp_path, "Z"),))[0], encoding="utf-8")
    page.open(tmp_path / "check.html", width=width, height=844)
    assert page.run("document.documentElement.scrollWidth") <= width
    assert page.complaints == []
    assert page.run("document.querySelectorAll('#map path.leaflet-interactive').length") > 3


@pytest.mark.parametrize("width", [390, 1400])
def test_axe_finds_nothing_serious(page: Page, tmp_path: Path, width: int) -> None:
    source = axe_source()
    (tmp_path / "check.html").write_text(page_of(tmp_path, *GOOD, no_fly=(zone(tmp_path, "Z"),))[0], encoding="utf-8")
    for colors in ("light", "dark"):
        page.open(tmp_path / "check.html", width=width, height=844, colors=colors)
        assert [one for one in findings(page, source) if one["impact"] in {"serious", "critical"}] == []
