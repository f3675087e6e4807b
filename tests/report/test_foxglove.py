"""A run as MCAP: what is in the file is what the run says, read back by mcap's own reader."""

import base64
import dataclasses
import io
import json
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.report.conftest import lines_over, resumed, two_sorties, write_run
from tests.report.test_report_of_pictures import CAMERA
from uavcover.model.no_fly import NoFly
from uavcover.report import foxglove
from uavcover.report.content import ReportContent, read_run
from uavcover.report.foxglove import NOT_SEEN, SCHEMAS, SEEN, Message, messages, orientations, packed
from uavcover.report.map_data import map_data
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site

_TYPES: dict[str, tuple[type, ...]] = {
    "number": (int, float), "integer": (int,), "string": (str,), "boolean": (bool,), "null": (type(None),),
}  # fmt: skip


def wrong(value: Any, schema: dict[str, Any], where: str = "") -> list[str]:
    """What a message has that its schema does not say, or the other way round."""
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if kinds == ["object"]:
        if not isinstance(value, dict) or set(value) != set(schema["properties"]):
            return [f"{where}: {value}"]
        return [line for key, of in schema["properties"].items() for line in wrong(value[key], of, f"{where}.{key}")]
    if kinds == ["array"]:
        return [line for k, item in enumerate(value) for line in wrong(item, schema["items"], f"{where}[{k}]")]
    fits = isinstance(value, tuple(kind for name in kinds for kind in _TYPES[name]))
    return [] if fits and (not isinstance(value, bool) or "boolean" in kinds) else [f"{where}: {value!r}"]


def planned_only(folder: Path, site: Site) -> RunFolder:
    return write_run(folder, site, lines_over(site, spacing_m=300.0, count=2), flown=False)


def with_pictures(folder: Path, site: Site) -> RunFolder:
    pictured = load_site(dataclasses.replace(site.scenario, sensor=CAMERA))
    return write_run(folder, pictured, lines_over(pictured, spacing_m=90.0, count=2), flown=True)


KINDS: dict[str, Callable[[Path, Site], RunFolder]] = {
    "planned": planned_only, "sorties": two_sorties, "resumed": resumed, "pictures": with_pictures,
}  # fmt: skip


@pytest.fixture(scope="module", params=[*KINDS, "flown"])
def any_run(
    request: pytest.FixtureRequest, site: Site, content: ReportContent, tmp_path_factory: pytest.TempPathFactory
) -> ReportContent:
    if request.param == "flown":
        return content
    return read_run(KINDS[request.param](tmp_path_factory.mktemp("mcap") / "run", site), logs=())


def by_topic(content: ReportContent) -> dict[str, list[Message]]:
    found = defaultdict(list)
    for message in messages(content):
        found[message.topic].append(message)
    return found


def test_every_message_is_as_its_schema_says(any_run: ReportContent) -> None:
    seen = set()
    for message in messages(any_run):
        assert wrong(message.content, SCHEMAS[message.schema], message.topic) == []
        json.dumps(message.content, allow_nan=False)
        assert message.time_ns >= 0
        stamp = message.content.get("timestamp")
        assert stamp is None or stamp["sec"] * 10**9 + stamp["nsec"] == message.time_ns
        seen.add(message.schema)
    assert {"foxglove.SceneUpdate", "foxglove.GeoJSON"} <= seen
    assert ("foxglove.Grid" in seen) == (any_run.verdict is not None)


def test_every_sample_is_there_on_the_clock_of_the_report(any_run: ReportContent) -> None:
    topics = by_topic(any_run)
    for number, flight in enumerate(any_run.flights, start=1):
        for name in ("transform", "pose", "location", "state"):
            told = topics[f"/flight_{number}/{name}"]
            assert len(told) == len(flight.track)
            np.testing.assert_allclose([m.time_ns * 1e-9 for m in told], flight.clock_s, atol=1e-9)
        fixes = [m.content for m in topics[f"/flight_{number}/location"]]
        np.testing.assert_array_equal(
            [(f["latitude"], f["longitude"], f["altitude"]) for f in fixes], flight.track.geodetic
        )
        places = [list(m.content["pose"]["position"].values()) for m in topics[f"/flight_{number}/pose"]]
        np.testing.assert_array_equal(places, flight.enu_m)
        states = [m.content for m in topics[f"/flight_{number}/state"]]
        np.testing.assert_array_equal([s["current_waypoint"] for s in states], flight.track.current_waypoint)
    assert f"/flight_{len(any_run.flights) + 1}/pose" not in topics


def test_the_planned_route_and_its_place_on_earth(any_run: ReportContent) -> None:
    topics = by_topic(any_run)
    (scene,) = topics["/planned/scene"]
    route = scene.content["entities"][0]
    assert route["metadata"] == [{"key": "name", "value": "planned route"}]
    waypoints = any_run.planned.route.waypoints_m
    np.testing.assert_array_equal([list(p.values()) for p in route["lines"][0]["points"]], waypoints)
    assert len({entity["id"] for entity in scene.content["entities"]}) == len(scene.content["entities"]) >= 3
    (document,) = topics["/planned/geojson"]
    drawn = json.loads(document.content["geojson"])["features"][0]["geometry"]["coordinates"]
    frame = any_run.site.frame
    assert frame is not None
    lat, lon, _ = frame.geodetic_from_enu(waypoints * [1.0, 1.0, 0.0])
    np.testing.assert_allclose(drawn, np.column_stack([lon, lat]), atol=1e-12)


def test_the_grid_fills_as_the_cells_were_seen(any_run: ReportContent) -> None:
    if any_run.verdict is None:
        assert "/coverage/grid" not in by_topic(any_run)
        return
    topics, verdict = by_topic(any_run), any_run.verdict
    cells = any_run.coverage.grid.cells
    start_s = float(any_run.flights[0].track.time_s[0])
    grids = topics["/coverage/grid"]
    for message in (grids[0], grids[len(grids) // 2], grids[-1]):
        told = message.content
        states = np.frombuffer(base64.b64decode(told["data"]), np.uint8).reshape(-1, told["column_count"])
        seen = verdict.flown.first_seen_s - start_s <= message.time_ns * 1e-9 + 1e-9
        # Each cell by its place: the square of the grid that its middle lies in.
        corner, size = told["pose"]["position"], told["cell_size"]["x"]
        middles = any_run.coverage.grid.middles_m
        column = ((middles[:, 0] - corner["x"]) / size).astype(int)
        row = ((middles[:, 1] - corner["y"]) / size).astype(int)
        np.testing.assert_array_equal(states[row, column], np.where(seen, SEEN, NOT_SEEN))
        assert (states > 0).sum() == any_run.coverage.grid.count
        assert size == cells.size_m
    percent = [m.content["seen_percent"] for m in topics["/coverage/percent"]]
    assert percent == sorted(percent)
    assert percent[-1] == pytest.approx(100.0 * verdict.report.coverage_fraction)


def test_pictures_are_where_they_were_taken(any_run: ReportContent) -> None:
    told = by_topic(any_run).get("/pictures/location", [])
    if any_run.verdict is None or any_run.verdict.pictures is None:
        assert told == []
    else:
        assert len(told) == any_run.verdict.pictures.taken > 20


def test_the_reader_of_mcap_reads_all_of_it(any_run: ReportContent) -> None:
    reader_module = pytest.importorskip("mcap.reader", reason="the package mcap (extra mcap) is not installed")
    told = sorted(messages(any_run), key=lambda message: message.time_ns)
    file = packed(any_run, told)
    reader = reader_module.make_reader(io.BytesIO(file), validate_crcs=True)
    read = list(reader.iter_messages())
    assert len(read) == len(told)
    for (schema, channel, message), expected in zip(read, told, strict=True):
        assert (schema.name, channel.topic, message.log_time) == (expected.schema, expected.topic, expected.time_ns)
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
    for schema, _, message in read[:: max(1, len(read) // 200)]:
        assert wrong(json.loads(message.data), json.loads(schema.data)) == []
    (facts,) = [record.metadata for record in reader.iter_metadata()]
    assert facts["scenario"] == "jacksboro"
    assert facts["verdict"] == ("not flown" if any_run.verdict is None else any_run.verdict.report.verdict)
    assert packed(any_run, told) == file


def test_orientations_turn_the_nose_as_aviation_does() -> None:
    rng = np.random.default_rng(8)
    attitude = np.column_stack([rng.uniform(-180, 180, 200), rng.uniform(-85, 85, 200), rng.uniform(0, 360, 200)])
    enu = np.cumsum(rng.normal(size=(200, 3)), axis=0)
    # Independently: yaw, pitch, roll from north-east-down to forward-right-down, by scipy.
    body_to_ned = Rotation.from_euler("ZYX", attitude[:, ::-1], degrees=True)
    turned = Rotation.from_quat(orientations(attitude, enu))
    for axis_flu, axis_frd in (([1, 0, 0], [1, 0, 0]), ([0, 1, 0], [0, -1, 0]), ([0, 0, 1], [0, 0, -1])):
        north, east, down = body_to_ned.apply(axis_frd).T
        np.testing.assert_allclose(turned.apply(axis_flu), np.column_stack([east, north, -down]), atol=1e-12)


def test_without_attitude_the_vehicle_is_level_and_looks_ahead() -> None:
    enu = np.column_stack([np.arange(5.0), 2.0 * np.arange(5.0), np.zeros(5)])
    for unknown in (np.full((5, 3), np.nan), np.column_stack([np.zeros((5, 2)), np.full(5, np.nan)])):
        nose = Rotation.from_quat(orientations(unknown, enu)).apply([1.0, 0.0, 0.0])
        np.testing.assert_allclose(nose, np.tile([1.0, 2.0, 0.0] / np.sqrt(5.0), (5, 1)), atol=1e-12)
    assert np.isfinite(orientations(np.full((1, 3), np.nan), enu[:1])).all()


def test_a_scenario_without_a_place_on_earth_has_no_places_on_earth(tmp_path: Path) -> None:
    area = dataclasses.replace(load_scenario("paper-R2").area, cell_size_m=0.5)
    site = load_site(dataclasses.replace(load_scenario("paper-R2"), area=area))
    run = write_run(tmp_path / "run", site, lines_over(site, spacing_m=2.0, count=3), flown=False)
    assert set(by_topic(read_run(run, logs=()))) == {"/planned/scene"}


def test_it_names_the_schemas_that_it_uses() -> None:
    assert {name for name in SCHEMAS if name.startswith("uavcover.")} == {"uavcover.VehicleState", "uavcover.Coverage"}
    page = Path("docs/how-to/other_controllers.md").read_text(encoding="utf-8")
    for name in SCHEMAS:
        assert f"`{name}`" in page, name
    assert foxglove.FRAME in page


def test_no_fly_zones_are_drawn_from_floor_to_ceiling(site: Site, tmp_path: Path) -> None:
    west, south, east, north = site.fence.bounds
    ring = tuple(
        (west + a * (east - west), south + b * (north - south)) for a, b in ((0.7, 0.7), (0.9, 0.7), (0.8, 0.9))
    )
    lat, lon, _ = (
        site.frame.geodetic_from_enu([(*corner, 0.0) for corner in ring]) if site.frame is not None else ((), (), ())
    )
    zone = NoFly(
        name="gliders", polygon_lon_lat_deg=tuple(zip(map(float, lon), map(float, lat), strict=True)), floor_agl_m=200.0,
        ceiling_agl_m=260.0,
    )  # fmt: skip
    zoned = load_site(dataclasses.replace(site.scenario, no_fly=(zone,)))
    content = read_run(planned_only(tmp_path / "run", zoned), logs=())
    topics = by_topic(content)
    (scene,) = topics["/planned/scene"]
    drawn = [entity for entity in scene.content["entities"] if "no-fly zone gliders" in entity["id"]]
    places = np.array([[p[axis] for axis in "xyz"] for entity in drawn for p in entity["lines"][0]["points"]])
    heights = zoned.ground.heights_agl_m(places)
    assert heights.min() == pytest.approx(200.0, abs=0.1)
    assert heights.max() == pytest.approx(260.0, abs=0.1)
    assert np.abs(places[:, :2].mean(axis=0) - np.mean(ring, axis=0)).max() < 60.0
    (features,) = topics["/planned/geojson"]
    names = [f["properties"]["name"] for f in json.loads(features.content["geojson"])["features"]]
    assert "no-fly zone gliders, from 200 m above ground to 260 m above ground" in names
    (shown,) = map_data(content)["noFly"]
    assert len(shown["lines"]) == len(drawn) >= 5
    assert max(up for line in shown["lines"] for _, _, up in line) == pytest.approx(places[:, 2].max(), abs=0.1)
