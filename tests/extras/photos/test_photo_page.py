"""The report on photos, as a page and as a GeoPackage."""

import builtins
import dataclasses
import json
import re
import sqlite3

import numpy as np
import pytest
import shapely

from tests.extras.photos.test_judge_photos import AREA, DEM, shots
from tests.report.conftest import HOSTILE
from tests.report.test_accessibility import axe_source, findings
from uavcover.errors import InputError, OutputError
from uavcover.extras.photos.photo import Photo
from uavcover.extras.photos.photo_judgement import PhotoRequest, judged
from uavcover.extras.photos.photo_page import (
    LAYERS,
    MAX_FOOTPRINTS,
    photo_map_data,
    render_photo_report,
    write_geopackage,
)
from uavcover.extras.photos.photo_verdict import footprints_geojson
from uavcover.extras.photos.placing import Assumptions
from uavcover.extras.photos.readers import PhotoSet
from uavcover.new.catalog import CURVES
from uavcover.new.command import new_scenario
from uavcover.new.elevation_questions import NewRequest
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.run.user import Unattended
from uavcover.scenario.areas.area_file import AreaQuery


@pytest.fixture(scope="module")
def verdict(tmp_path_factory):
    """On the first two thirds of a survey's pictures, one of which has no place and a name that would be markup."""
    request = NewRequest(area=AreaQuery(source=AREA), dem=(DEM,), camera="dji-m3e", gsd="2.5cm", overlap="75/70")
    site = new_scenario(request, Unattended(), folder=tmp_path_factory.mktemp("scenario")).site
    taken = shots(site, fly_layout(site, plain_boustrophedon(site)))
    photos = [
        Photo(name=f"p{k}", lat_deg=lat, lon_deg=lon, alt_m=alt, yaw_deg=yaw, pitch_deg=-90.0, time_s=float(time_s))
        for k, (lat, lon, alt, yaw, time_s) in enumerate(taken[: 2 * len(taken) // 3])
    ]
    required = PhotoRequest(
        photos=(), area=request, scenario=None, assumed=Assumptions(), takeoff=None, coverage=0.98, mount_known=True,
        refly=False, budget_s=None, force=False, detection=CURVES.named("person"), pod=0.95,
    )  # fmt: skip
    return judged(required, PhotoSet((*photos, Photo(name=HOSTILE)), ()), site, Unattended())


@pytest.fixture(scope="module")
def text(verdict):
    return render_photo_report(verdict)


def test_it_says_what_photos_json_says(verdict, text):
    reported = verdict.document
    assert "<b>Failed</b>" in text
    assert f"{reported['counted']} of {reported['pictures']}" in text
    assert f"{100.0 * reported['surely']:.2f} %" in text
    assert text.count('data-label="reason"') == 1 + min(30, len(verdict.gaps))
    assert reported["inputs"]["pictures"] in text
    assert f"{100.0 * reported['detection']['pod']:.2f} %; with only the best photo" in text
    assert "Johnson 1958" in text


def test_it_needs_no_network_and_files_are_no_markup(text):
    assert HOSTILE not in text
    assert "default-src &#39;none&#39;" in text
    without_data = re.sub(r'<script type="application/json".*?</script>', "", text, flags=re.DOTALL)
    page = re.sub(r"<script>.*?</script>", "", without_data, flags=re.DOTALL)
    assert not re.search(r'(src|href)="(?!#)', page)
    assert json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])["cells"]


def test_the_map_has_cells_pictures_footprints_and_gaps(verdict):
    data = photo_map_data(verdict)
    assert [layer["key"] for layer in data["cells"]][:4] == ["pictures-flown", "sample-flown", "coverage", "gaps"]
    assert data["cells"][-1]["key"] == "pod"
    assert len(data["pictures"]["flown"]) == verdict.document["counted"]
    assert len(data["gaps"]) == len(verdict.gaps) > 0
    number = 5
    eye = verdict.placed.eyes_m[number]
    ring = np.array(data["footprints"][number]["ring"])
    west, south, east, north = data["bounds"]
    assert west <= eye[0] <= east
    assert south <= eye[1] <= north
    # A camera that looks down stands over the middle of what it shows, give or take the slope.
    assert np.hypot(*(ring.mean(axis=0) - eye[:2])) < 15.0


def test_of_many_pictures_some_footprints_are_drawn(verdict):
    times = 2 * MAX_FOOTPRINTS // len(verdict.placed.photos) + 1
    parts = {
        name: np.concatenate([getattr(verdict.placed, name)] * times)
        for name in ("eyes_m", "axes", "tops", "direction_known", "horizontal_m", "vertical_m", "turn_deg")
    }
    many = dataclasses.replace(verdict.placed, photos=verdict.placed.photos * times, **parts)
    data = photo_map_data(dataclasses.replace(verdict, placed=many))
    assert MAX_FOOTPRINTS // 2 <= len(data["footprints"]) <= MAX_FOOTPRINTS


@pytest.mark.parametrize("width", [320, 390, 1200])
def test_it_fits_its_screen(page, tmp_path, text, width):
    (tmp_path / "photos.html").write_text(text)
    page.open(tmp_path / "photos.html", width=width, height=844)
    assert page.run("document.documentElement.scrollWidth") <= width
    assert page.run("document.querySelectorAll('#map path.footprint').length") > 10
    assert page.run("document.querySelectorAll('#map img.cells').length") == 1
    assert page.run("document.getElementById('legend').children.length") > 2
    assert page.complaints == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []


@pytest.mark.parametrize("width", [390, 1400])
def test_axe_finds_nothing_serious(page, tmp_path, text, width):
    source = axe_source()
    (tmp_path / "photos.html").write_text(text, encoding="utf-8")
    for colors in ("light", "dark"):
        page.open(tmp_path / "photos.html", width=width, height=844, colors=colors)
        assert [one for one in findings(page, source) if one["impact"] in {"serious", "critical"}] == []


pyogrio = pytest.importorskip("pyogrio")


def test_other_readers_find_the_layers_where_they_belong(tmp_path, verdict):
    path = tmp_path / "verdict.gpkg"
    write_geopackage(verdict, path, Unattended(), force=False)
    assert [str(name) for name, _ in pyogrio.list_layers(path)] == list(LAYERS)
    with sqlite3.connect(path) as database:
        systems = database.execute("SELECT DISTINCT organization, organization_coordsys_id FROM gpkg_contents "
                                   "JOIN gpkg_spatial_ref_sys USING (srs_id)").fetchall()  # fmt: skip
    assert systems == [("EPSG", 4326)]
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="footprints")
    assert meta["crs"] == "EPSG:4326"
    expected = footprints_geojson(verdict)["features"]
    assert [str(name) for name in fields[0]] == [feature["properties"]["name"] for feature in expected]
    one = shapely.from_wkb(shapes[3])
    assert shapely.equals_exact(shapely.force_2d(one), shapely.geometry.shape(expected[3]["geometry"]), tolerance=1e-9)
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="pictures")
    position = shapely.from_wkb(shapes[3])
    photo = verdict.placed.photos[3]
    assert (position.x, position.y) == pytest.approx((photo.lon_deg, photo.lat_deg), abs=1e-7)
    assert position.z == pytest.approx(photo.alt_m, abs=0.05)
    assert fields[list(meta["fields"]).index("tilt_deg")][3] == pytest.approx(0.0, abs=1e-5)
    meta, _, shapes, fields = pyogrio.raw.read(path, layer="gaps")
    assert sum(fields[list(meta["fields"]).index("area_m2")]) == pytest.approx(
        sum(gap["area_m2"] for gap in verdict.document["gaps"])
    )


def test_no_gap_is_an_empty_layer_and_no_file_is_replaced(tmp_path, verdict):
    path = tmp_path / "verdict.gpkg"
    write_geopackage(dataclasses.replace(verdict, gaps=[]), path, Unattended(), force=False)
    assert pyogrio.read_info(path, layer="gaps")["features"] == 0
    kept = path.read_bytes()
    with pytest.raises(OutputError, match="--force"):
        write_geopackage(verdict, path, Unattended(), force=False)
    assert path.read_bytes() == kept
    write_geopackage(verdict, path, Unattended(), force=True)
    assert pyogrio.read_info(path, layer="gaps")["features"] == len(verdict.gaps)
    assert [file.name for file in tmp_path.iterdir()] == ["verdict.gpkg"]
    with pytest.raises(OutputError, match="no such folder"):
        write_geopackage(verdict, tmp_path / "none/verdict.gpkg", Unattended(), force=False)


def test_without_the_extra_and_with_another_name_it_is_one_line(tmp_path, verdict, monkeypatch):
    with pytest.raises(InputError, match=r"must end in \.gpkg"):
        write_geopackage(verdict, tmp_path / "verdict.json", Unattended(), force=False)
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name.startswith("pyogrio"):
            raise ImportError(name)
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"uavcover\[gis\]"):
        write_geopackage(verdict, tmp_path / "verdict.gpkg", Unattended(), force=False)
    assert not list(tmp_path.iterdir())
