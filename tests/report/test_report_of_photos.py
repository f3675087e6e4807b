"""Pictures in the report: where they are, how many show each cell, and whether the overlap asked for holds."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.recording.flights import lines_over
from tests.report.browser import Page
from tests.report.conftest import coarse, read_of_perfect_tracks, write_run
from tests.report.test_in_browser import check_quiet
from tests.report.test_map_data import pixels
from tests.report.test_page import Elements
from uavcover.model.sensor import FrameCamera
from uavcover.report.content import ReportContent, read_run
from uavcover.report.map_data import (
    NOT_COVERABLE_RGB,
    OBSERVED_RGB,
    POSSIBLE_RGB,
    SURE_RGB,
    UNOBSERVED_RGB,
    cell_layers,
    map_data,
)
from uavcover.report.page import render_report
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site

CAMERA = FrameCamera(
    kind="frame-camera", fov_across_deg=74.0, fov_along_deg=53.0, range_m=250.0, pixels_across=5280, mount="stabilised",
    forward_overlap=0.75, side_overlap=0.6,
)  # fmt: skip


@pytest.fixture(scope="module")
def surveyed() -> Site:
    return coarse("jacksboro", 20.0, sensor=CAMERA)


@pytest.fixture(scope="module", params=["planned", "flown"])
def survey(request: pytest.FixtureRequest, surveyed: Site, tmp_path_factory: pytest.TempPathFactory) -> ReportContent:
    route = lines_over(surveyed, spacing_m=45.0, count=6)
    folder = tmp_path_factory.mktemp("survey") / "run"
    return read_of_perfect_tracks(write_run(folder, surveyed, route, flown=request.param == "flown"))


def test_the_layers_have_every_cell_in_the_colour_of_its_pictures(survey: ReportContent) -> None:
    layers = {layer.key: layer for layer in cell_layers(survey)}
    counts = {"planned": survey.planned_view.photos}
    if survey.verdict is not None:
        counts["flown"] = survey.verdict.photos
    else:
        assert list(layers) == ["planned-coverage", "pictures-planned", "sample-planned"]
    cells = survey.coverage.grid.cells
    row, column = np.nonzero(cells.lattice >= 0)
    for which, found in counts.items():
        assert found is not None
        image = pixels(layers[f"pictures-{which}"].image)[::-1][row, column, :3]
        photos = found.photos[cells.lattice[row, column]]
        # 75 and 60 % ask for 4 x 2.
        for rgb, low, high in (
            (NOT_COVERABLE_RGB, 0, 0), (UNOBSERVED_RGB, 1, 4), (POSSIBLE_RGB, 5, 7), (OBSERVED_RGB, 8, 15), (SURE_RGB, 16, 999),
        ):  # fmt: skip
            np.testing.assert_array_equal((image == rgb).all(axis=1), (photos >= low) & (photos <= high))
        assert "8 to 15" in [entry.label for entry in layers[f"pictures-{which}"].legend]
        sample = pixels(layers[f"sample-{which}"].image)
        assert (sample[..., 3] > 0).sum() == (found.photos > 0).sum()
    assert ("sample-flown" in layers) == (survey.verdict is not None)
    assert "sample" not in layers


def test_every_picture_has_its_place(survey: ReportContent) -> None:
    photos = map_data(survey)["pictures"]
    assert len(photos["planned"]) == survey.planned_view.poses.eyes.shape[0] > 100
    np.testing.assert_allclose(photos["planned"], survey.planned_view.poses.eyes, atol=0.06)
    if survey.verdict is None:
        assert photos["flown"] == []
    else:
        np.testing.assert_allclose(photos["flown"], survey.verdict.observations.positions_m, atol=0.06)
        assert abs(len(photos["flown"]) - len(photos["planned"])) < 5


def test_the_page_has_the_verdict_on_the_overlap(survey: ReportContent) -> None:
    page = Elements(render_report(survey))
    section = page.table("Photos and overlap").split("Heights and coverage")[0]
    assert "4 x 2 = 8 photos" in section
    statistics = survey.planned_view.statistics
    assert statistics is not None
    assert statistics.overlap_fraction is not None
    assert f"{100.0 * statistics.overlap_fraction:.2f} %" in section
    # Six of many lines: it does not hold.
    assert statistics.overlap_holds is False
    assert section.count("NO") == (1 if survey.verdict is None else 2)
    if survey.verdict is not None:
        judged = survey.verdict.report.pictures
        assert judged is not None
        assert f"{100.0 * (judged.overlap_fraction or 0.0):.2f} %" in section
        assert any("the required overlap, 8 photos" in line for line in survey.verdict.report.findings)


def test_a_sensor_without_single_pictures_has_no_such_section(html: str, content: ReportContent) -> None:
    assert "Photos and overlap" not in html
    assert map_data(content)["pictures"] == {"planned": [], "flown": [], "unknown": 0}


def test_the_pictures_on_the_map(page: Page, survey: ReportContent, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(render_report(survey))
    page.open(path, width=1400)
    overlays = page.run(
        "[...document.querySelectorAll('.leaflet-control-layers-overlays label')].map(l => l.textContent.trim())"
    )
    stated = dict(re.findall(r"Photos, (\w+) \((\d+)\)", "\n".join(overlays)))
    flown = survey.verdict is not None
    assert set(stated) == ({"planned", "flown"} if flown else {"planned"})
    shown = "flown" if flown else "planned"
    if not flown and int(stated["planned"]) > 100:
        # More than 100 would hide the route: they are switched on when they are wanted.
        assert page.run("document.querySelectorAll('#map path.picture').length") == 0
        number = next(k for k, name in enumerate(overlays) if name.startswith("Photos, planned"))
        page.run(f"document.querySelectorAll('.leaflet-control-layers-overlays input')[{number}].click()")
    drawn = page.run(f"document.querySelectorAll('#map path.picture.{shown}').length")
    assert 50 < drawn <= int(stated[shown])
    if flown:
        # Those that were planned are switched on when they are wanted.
        assert page.run("document.querySelectorAll('#map path.picture.planned').length") == 0
        number = next(k for k, name in enumerate(overlays) if name.startswith("Photos, planned"))
        page.run(f"document.querySelectorAll('.leaflet-control-layers-overlays input')[{number}].click()")
        assert page.run("document.querySelectorAll('#map path.picture.planned').length") > 50
    page.run(
        f"document.querySelector('#map path.picture.{shown}').dispatchEvent(new MouseEvent('click', {{bubbles: true}}))"
    )
    assert f"photo 1, {shown}" in page.run("document.querySelector('.leaflet-popup-content').textContent")
    legend = page.run("document.querySelector('#line-legend').textContent")
    assert f"photo, {shown}" in legend
    check_quiet(page)


@pytest.mark.parametrize("margin_m", [0.0, 40.0])
def test_the_area_as_drawn_is_told_from_its_margin(margin_m: float, tmp_path: Path) -> None:
    scenario = load_scenario("jacksboro")
    area = dataclasses.replace(scenario.area, cell_size_m=20.0, margin_m=margin_m)
    site = load_site(dataclasses.replace(scenario, area=area, sensor=CAMERA))
    run = write_run(tmp_path / "run", site, lines_over(site, spacing_m=90.0, count=2), flown=False)
    data = map_data(read_run(run, logs=()))
    assert bool(data["drawn"]) == (margin_m > 0.0)
    if margin_m:
        (drawn,), (grown,) = data["drawn"], data["area"]
        assert shapely.Polygon(grown).contains(shapely.Polygon(drawn))
        assert shapely.Polygon(grown).exterior.distance(shapely.Polygon(drawn)) == pytest.approx(margin_m, abs=0.2)
