"""What the map draws lies where it is."""

import base64
import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.planner.sites import flat, make_site, tower
from uavcover.model.limits import NoFly, Obstacles
from uavcover.report import map_data as drawing
from uavcover.report.content import FIGURES, ReportContent
from uavcover.report.map_data import UNOBSERVED_RGB, cell_layers, cells_bounds_m, map_data


def pixels(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))


@pytest.fixture(scope="module")
def data(content: ReportContent) -> dict[str, Any]:
    return map_data(content)


def test_every_cell_has_its_pixel(content: ReportContent) -> None:
    assert content.verdict is not None
    coverage, observed = content.coverage, content.verdict.flown.observed
    layer = cell_layers(content)[0]
    image = pixels(layer.image)
    west, _, east, north = cells_bounds_m(coverage)
    size = (east - west) / image.shape[1]
    assert size == pytest.approx(coverage.grid.cells.size_m)
    centres = coverage.grid.cells.centre_m
    column = ((centres[:, 0] - west) / size).astype(int)
    row = ((north - centres[:, 1]) / size).astype(int)
    np.testing.assert_array_equal((image[row, column, :3] == UNOBSERVED_RGB).all(axis=1), ~observed)
    assert image[..., 3].astype(bool).sum() == coverage.grid.count
    assert [entry.label for entry in layer.legend] == ["observed", "not observed"]


def test_layers_of_looks_time_angle_and_distance(content: ReportContent) -> None:
    assert content.verdict is not None
    layers = {layer.key: layer for layer in cell_layers(content)}
    # The demo's camera has no pixel count, so there is no ground sample distance to show.
    assert list(layers) == ["coverage", "gaps", "looks", "first-seen", "incidence", "distance"]
    flown = content.verdict.flown
    labels = [entry.label for entry in layers["distance"].legend if entry.label]
    assert labels == [f"{np.nanmin(flown.nearest_m):.0f} m", f"{np.nanmax(flown.nearest_m):.0f} m"]
    assert (pixels(layers["looks"].image)[..., 3] > 0).sum() == flown.observed.sum()
    assert (pixels(layers["gaps"].image)[..., 3] > 0).sum() == (~flown.observed).sum()


def test_the_pointer_tells_the_place_that_the_frame_tells(content: ReportContent, data: dict[str, Any]) -> None:
    frame = content.site.frame
    assert frame is not None
    west, south, east, north = data["bounds"]
    rng = np.random.default_rng(5)
    positions = np.column_stack([rng.uniform(west, east, 100), rng.uniform(south, north, 100), np.zeros(100)])
    e, n = positions[:, 0] / 1000.0, positions[:, 1] / 1000.0
    basis = np.column_stack([np.ones(100), e, n, e * e, e * n, n * n])
    lat, lon, _ = frame.geodetic_from_enu(positions)
    # 1e-7 degrees are 11 mm; the page shows six digits.
    np.testing.assert_allclose(basis @ data["geodetic"]["lat"], lat, atol=1e-7)
    np.testing.assert_allclose(basis @ data["geodetic"]["lon"], lon, atol=1e-7)


def test_the_surface_is_the_ground_with_north_on_top(content: ReportContent, data: dict[str, Any]) -> None:
    surface, (west, south, east, north) = data["surface"], data["bounds"]
    up = np.array(surface["up"]).reshape(surface["rows"], surface["columns"])
    corners = [(west, north), (east, north), (west, south), (east, south)]
    expected = content.site.ground.heights_m(np.array(corners))
    np.testing.assert_allclose([up[0, 0], up[0, -1], up[-1, 0], up[-1, -1]], expected, atol=0.06 + 0.5)
    # The west of the demo's area is 300 m above its east.
    relief = pixels(data["relief"]).astype(float).mean(axis=2)
    assert relief.shape[0] == pytest.approx(relief.shape[1] * (north - south) / (east - west), abs=1)


def test_tracks_are_thinned_and_end_where_they_end(content: ReportContent, monkeypatch: pytest.MonkeyPatch) -> None:
    (flight,) = content.flights
    monkeypatch.setattr(drawing, "FIGURES", replace(FIGURES, max_samples=100))
    (track,) = map_data(content)["tracks"]
    assert len(track["points"]) == len(track["times"]) == len(track["heights"]) <= 102
    np.testing.assert_allclose(track["points"][-1], flight.enu_m[-1], atol=0.051)
    assert track["times"][-1] == pytest.approx(flight.duration_s, abs=0.051)


def test_gaps_are_told_with_their_reason(content: ReportContent, data: dict[str, Any]) -> None:
    assert content.verdict is not None
    assert len(data["gaps"]) == len(content.verdict.report.gaps) > 0
    assert data["gaps"][0]["reason"] == "never in range and field of view"


def test_obstacles_with_their_names_heights_and_grounds() -> None:
    site = make_site(flat, obstacles=Obstacles(prisms=(tower(10, 20, 30, 50, 17.5, name="silo"),)))
    (drawn,) = [drawing._obstacle(site, prism) for prism in site.prisms]
    assert (drawn["name"], drawn["height"], drawn["top"]) == ("silo", 17.5, 17.5)
    (ring,) = drawn["rings"]
    assert {tuple(position) for position in ring} == {
        (10.0, 20.0, 0.0),
        (30.0, 20.0, 0.0),
        (30.0, 50.0, 0.0),
        (10.0, 50.0, 0.0),
    }


def test_no_fly_zones_are_drawn_where_they_are() -> None:
    zone = NoFly(center_east_north_m=(40.0, 70.0), radius_m=25.0, floor_agl_m=60.0, name="helipad")
    site = make_site(flat, no_fly=(zone,))
    drawn = drawing.zone_data(site.zones[0])
    assert (drawn["name"], drawn["heights"]) == ("helipad", "from 60 m above ground up")
    (ring,) = drawn["rings"]
    away = np.hypot(*(np.array(ring) - (40.0, 70.0)).T)
    assert away.min() >= 24.9
    assert away.max() <= 25.2
