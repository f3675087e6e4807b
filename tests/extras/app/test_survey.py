"""What is drawn and typed becomes the same scenario as by ``uavcover new``; what is wrong is said at its field."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.extras.app.conftest import Client
from uavcover.scenario.site import load_site

AREA = {
    "type": "Polygon",
    "coordinates": [[[-84.216, 36.470], [-84.209, 36.470], [-84.209, 36.475], [-84.216, 36.475], [-84.216, 36.470]]],
}
ZONE = {
    "type": "Polygon",
    "coordinates": [[[-84.213, 36.472], [-84.212, 36.472], [-84.212, 36.473], [-84.213, 36.472]]],
}
FORM = {"name": "drawn", "area": AREA, "camera": "dji-m3e", "gsd": "3cm", "overlap": "75/70", "vertical_datum": "EGM96"}


@pytest.fixture
def with_dem(served: Client) -> Client:
    data = Path(load_site.__code__.co_filename).parents[1] / "data" / "jacksboro.tif"
    (served.root / "dem.tif").write_bytes(data.read_bytes())
    return served


def form(**changes: Any) -> dict[str, Any]:
    return {**FORM, "dem": ["dem.tif"], **changes}


def test_what_follows_from_the_form(with_dem: Client) -> None:
    before = sorted(path.name for path in with_dem.root.iterdir())
    found = with_dem.post("/api/design", form(battery="25min"))
    assert found["flights"][0]["batteries"] >= 1
    assert found["flights"][0]["pictures"] > 50
    assert 50.0 < found["figures"]["max_height_agl_m"] <= 120.0
    assert found["home"] is not None
    assert sorted(path.name for path in with_dem.root.iterdir()) == before, "nothing is written"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"gsd": "0"}, "gsd"), ({"gsd": "three"}, "gsd"), ({"overlap": "120/70"}, "overlap"), ({"camera": "no-such"}, "camera"),
        ({"battery": "soon"}, "battery"), ({"max_height": "-5m"}, "max_height"), ({"vehicle": "no-such"}, "vehicle"),
        ({"home": "91,0"}, "home"), ({"pattern": "spiral"}, "pattern"),
    ],
    ids=str,
)  # fmt: skip
def test_what_is_wrong_is_said_at_its_field(with_dem: Client, changes: dict[str, str], field: str) -> None:
    found = with_dem.post("/api/design", form(**changes))
    assert found["field"] == field, found
    assert found["error"]


def _polygon(*ring: list[Any]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [list(ring)]}


CROSSING = _polygon([0, 0], [1, 1], [1, 0], [0, 1], [0, 0])
NO_AREAS = (
    None, {}, {"type": "Point", "coordinates": [1, 2]}, {"type": "Polygon", "coordinates": []}, [1], 7, CROSSING,
    _polygon([0, 95], [1, 95], [1, 96], [0, 95]), _polygon(["a", 0], [1, 1], [1, 0], ["a", 0]),
)  # fmt: skip


@pytest.mark.parametrize("area", NO_AREAS, ids=repr)
def test_an_area_that_is_none_is_refused(with_dem: Client, area: Any) -> None:
    assert with_dem.post("/api/design", form(area=area))["error"].startswith("area: ")


def test_a_saved_scenario_is_that_of_the_command(with_dem: Client, cli: Any) -> None:
    zone = {"name": "<b>tower</b>", "geometry": ZONE, "ceiling_agl_m": "90"}
    saved = with_dem.post("/api/scenarios", form(zones=[zone], home="36.4728,-84.2150"))
    assert saved["scenarios"] == ["drawn.toml"]
    site = load_site(str(with_dem.root / "drawn.toml"))
    assert [each.name for each in site.zones] == ["<b>tower</b>"]
    assert site.zones[0].entry.ceiling_agl_m == 90.0
    root = with_dem.root
    cli(
        "new", root / "drawn-area.geojson", "--dem", root / "dem.tif", "--camera", "dji-m3e", "--gsd", "3cm",
        "--overlap", "75/70", "--vertical-datum", "EGM96", "--no-fly", root / "drawn-zones.geojson",
        "--home", "36.4728,-84.2150", "-o", root / "typed.toml",
     code=0)  # fmt: skip
    typed, drawn = (root / "typed.toml").read_text(), (root / "drawn.toml").read_text()
    assert typed.replace("typed", "drawn") == drawn


FENCE = _polygon([-84.219, 36.467], [-84.206, 36.467], [-84.206, 36.478], [-84.219, 36.478], [-84.219, 36.467])


def test_a_drawn_fence_and_rally_points_are_keys_of_the_scenario_and_reach_the_mission(with_dem: Client) -> None:
    rally = [[-84.2172, 36.4712], [-84.2079, 36.4731]]
    saved = with_dem.post("/api/scenarios", form(fence=FENCE, rally=rally, max_alt="1000m", home="36.4728,-84.2150"))
    assert saved["scenarios"] == ["drawn.toml"]
    path = with_dem.root / "drawn.toml"
    site = load_site(str(path))
    assert site.scenario.limits.fence_lon_lat_deg == tuple(map(tuple, FENCE["coordinates"][0][:-1]))
    assert site.scenario.limits.max_alt_amsl_m == 1000.0
    assert site.scenario.planner.rally == tuple(map(tuple, rally))
    scene = with_dem.get("/api/scene?name=drawn.toml")
    assert scene["fence"][0] == [pytest.approx(corner, abs=1e-6) for corner in FENCE["coordinates"][0]]
    assert scene["rally"] == rally


INSIDE_ZONE = {"name": "tower", "geometry": ZONE}
WRONG_SHAPES = (
    ({"fence": CROSSING}, "fence"), ({"fence": {"type": "Point", "coordinates": [1, 2]}}, "fence"), ({"fence": 7}, "fence"),
    ({"fence": {"type": "Polygon", "coordinates": [*FENCE["coordinates"], *AREA["coordinates"]]}}, "fence"),
    ({"fence": AREA, "home": "36.478,-84.215"}, "home"), ({"rally": "here"}, "rally"), ({"rally": [[1]]}, "rally"),
    ({"rally": [[-84.3, 36.47]]}, "rally"), ({"rally": [[36.47, -94.2]]}, "rally"), ({"rally": [[None, 1]]}, "rally"),
    ({"rally": [[-84.2123, 36.4722]], "zones": [INSIDE_ZONE]}, "rally"), ({"max_alt": "high"}, "max_alt"),
)  # fmt: skip


@pytest.mark.parametrize(("changes", "field"), WRONG_SHAPES, ids=str)
def test_a_wrong_fence_or_rally_point_is_said_at_its_field(
    with_dem: Client, changes: dict[str, Any], field: str
) -> None:
    found = with_dem.post("/api/design", form(**changes))
    assert found["field"] == field, found


def test_an_area_that_sticks_out_of_the_fence_is_said(with_dem: Client) -> None:
    small = _polygon([-84.219, 36.467], [-84.212, 36.467], [-84.212, 36.478], [-84.219, 36.478], [-84.219, 36.467])
    found = with_dem.post("/api/design", form(fence=small))
    assert any("outside the fence" in message.get("warn", "") for message in found["messages"]), found


def test_saving_twice_replaces_nothing(with_dem: Client) -> None:
    assert with_dem.post("/api/scenarios", form())["scenarios"] == ["drawn.toml"]
    before = (with_dem.root / "drawn.toml").read_bytes()
    assert with_dem.post("/api/scenarios", form(gsd="2cm"))["scenarios"] == ["drawn-2.toml"]
    assert (with_dem.root / "drawn.toml").read_bytes() == before


@pytest.mark.parametrize("name", ["../x", "", "a/b", "x" * 80, "-x", ".x", "<script>"])
def test_a_name_that_is_no_file_is_refused(with_dem: Client, name: str) -> None:
    if name:
        assert with_dem.error("POST", "/api/scenarios", form(name=name)).startswith("name: ")


def test_a_form_that_fails_leaves_no_file(with_dem: Client) -> None:
    before = sorted(path.name for path in with_dem.root.iterdir())
    assert with_dem.error("POST", "/api/scenarios", form(gsd="wide", zones=[{"geometry": ZONE}]))
    assert sorted(path.name for path in with_dem.root.iterdir()) == before


def test_an_area_of_any_format_is_read(served: Client) -> None:
    found = served.get("/api/area?name=valley.geojson")
    assert found["geometry"]["type"] == "MultiPolygon"
    given = json.loads((served.root / "valley.geojson").read_text())
    corners = {tuple(round(v, 7) for v in corner) for corner in found["geometry"]["coordinates"][0][0]}
    assert corners == {
        tuple(round(v, 7) for v in corner) for corner in next(iter(given["features"]))["geometry"]["coordinates"][0]
    }


def test_a_position_is_typed(served: Client) -> None:
    assert served.get("/api/place?text=47.37%2C%208.54")["place"] == [8.54, 47.37]
    assert "is not a position" in served.error("GET", "/api/place?text=here")
