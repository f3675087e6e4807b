"""Hostile files, names and messages, and things that go away while the page uses them: one line each, and the server lives."""

import json
import re
import shutil
import sqlite3
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.extras.app.browser import opened
from tests.extras.app.conftest import WATCHDOG_S, Client
from uavcover.errors import InputError
from uavcover.extras.app import server, tiles
from uavcover.terrain.terrain_source import TerrainSource

MARKUP = "<img src=x onerror=alert(1)>"
DEEP = 30_000


def alive(served: Client) -> bool:
    return bool(served.get("/api/state")["folder"])


def watching(served: Client) -> connect:
    headers = {"Cookie": f"uavcover-{served.port}={served.token}"}
    return connect(f"ws://{served.host}/ws", origin=f"http://{served.host}", additional_headers=headers, max_size=None)  # type: ignore[arg-type]


def read_all(socket: Any, *sent: str) -> None:
    """Send, and read until the connection ends."""
    for message in sent:
        socket.send(message)
    while True:
        socket.recv(timeout=WATCHDOG_S)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_markup_in_every_name_is_text(browser: Any, served: Client, planned: Path) -> None:
    """Names of files, folders, scenarios, areas, zones and vehicles."""
    for name in (f"{MARKUP}.toml", f"{MARKUP}.kml", f"{MARKUP}.tif", f"{MARKUP}.mbtiles"):
        (served.root / name).write_text("[area]\n")
    (served.root / MARKUP).mkdir()
    (served.root / MARKUP / "plan.json").write_text("{}")
    run = shutil.copytree(planned, served.root / "run")
    scenario = (run / "scenario.toml").read_text()
    (run / "scenario.toml").write_text(
        re.sub(r"(?m)^description = .*\n", "", scenario).replace("[area]", f'description = "{MARKUP}"\n[area]', 1)
    )
    zone = {"type": "Polygon", "coordinates": [[[8.0, 47.0], [8.1, 47.0], [8.1, 47.1], [8.0, 47.0]]]}
    p = opened(browser, served)
    p.page.evaluate(
        "([name, zone]) => { window.uavcover.state.draft.zones.push({ name, geometry: zone }); window.uavcover.state.redraw(); }",
        [MARKUP, zone],
    )
    p.page.select_option("#f-open", "run")
    p.until("window.uavcover.state.scene?.plan")
    for tab in ("area", "plan", "fly", "judge"):
        p.page.click(f"#tab-{tab}")
    p.page.evaluate("(text) => { for (const kind of ['', 'warn', 'error']) window.uavcover.say(text, kind); }", MARKUP)
    assert MARKUP in p.page.inner_text("#place")
    assert MARKUP in p.messages()
    assert p.page.locator("img").count() == 0
    assert p.errors == []
    assert p.foreign == []


@pytest.mark.parametrize(
    "value", [10**15, None, "<svg onload=alert(1)>", b"", b"\x89PNG" + b"x" * (5 << 20)], ids=lambda v: repr(v)[:12]
)
def test_an_mbtiles_file_with_anything_as_a_tile(tmp_path: Path, value: object) -> None:
    path = tmp_path / "map.mbtiles"
    with sqlite3.connect(path) as connection:
        connection.execute("create table tiles (zoom_level, tile_column, tile_row, tile_data)")
        connection.execute("insert into tiles values (3, 2, 6, ?)", (value,))
    connection.close()
    assert tiles.background_tile(path, 3, 2, 1) is None


def test_an_mbtiles_file_that_computes_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.mbtiles"
    monkeypatch.setattr(tiles, "_MBTILES_S", 0.1)
    with sqlite3.connect(path) as connection:
        connection.execute(
            "create view tiles as with recursive n(i) as (select 1 union all select i + 1 from n)"
            " select 3 as zoom_level, 2 as tile_column, 6 as tile_row, x'89' as tile_data from n where i < 0"
        )
    connection.close()
    with pytest.raises(InputError, match=r"map\.mbtiles"):
        tiles.background_tile(path, 3, 2, 1)


def test_a_raster_of_a_billion_pixels_keeps_no_other_tile_waiting(tmp_path: Path) -> None:
    path = tmp_path / "huge.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=40_000, height=40_000, count=1, dtype="int16", crs="EPSG:4326", nodata=-1,
        transform=rasterio.Affine(1e-4, 0.0, 8.0, 0.0, -1e-4, 50.0), sparse_ok=True, tiled=True,
    ) as dataset:  # fmt: skip
        dataset.write(np.full((1, 512, 512), 300, dtype=np.int16), window=rasterio.windows.Window(0, 0, 512, 512))
    begin_s = time.process_time()
    assert tiles.background_tile(path, 2, 2, 1) is None
    assert tiles.height_tile(TerrainSource((path,)), 2, 2, 1)
    assert time.process_time() - begin_s < 5.0, "33 s before"
    found = tiles.background_tile(path, 11, *tile_at(8.02, 49.98, 11))
    assert found is not None, "near enough, it is drawn"


def tile_at(lon: float, lat: float, zoom: int) -> tuple[int, int]:
    x = (lon + 180.0) / 360.0 * 2**zoom
    y = (1.0 - np.arcsinh(np.tan(np.radians(lat))) / np.pi) / 2.0 * 2**zoom
    return int(x), int(y)


@pytest.mark.parametrize(("open_", "close"), [('{"a":', "}"), ("[", "]")])
def test_json_nested_without_end(served: Client, open_: str, close: str) -> None:
    deep = open_ * DEEP + "1" + close * DEEP
    status, _, _ = served.ask("POST", "/api/design", deep.encode())
    assert status == 400
    (served.root / "deep.geojson").write_text(deep)
    assert "deep.geojson" in served.error("GET", "/api/area?name=deep.geojson")
    waypoints = f'{{"run": "x", "waypoints": {"[" * 200 + "]" * 200}}}'
    assert served.ask("POST", "/api/route/check", waypoints.encode())[0] == 400
    assert alive(served)


def test_an_area_that_unpacks_to_gigabytes(served: Client) -> None:
    """A KMZ file of 2 MB with 2 GB in it is refused, and not unpacked into memory."""
    with (
        zipfile.ZipFile(served.root / "bomb.kmz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("doc.kml", "w", force_zip64=True) as file,
    ):
        block = b" " * (16 << 20)
        for _ in range(128):
            file.write(block)
    begin_s = time.process_time()
    assert "bomb.kmz" in served.error("GET", "/api/area?name=bomb.kmz")
    assert time.process_time() - begin_s < 20.0


def test_a_message_of_100_megabytes_ends_its_connection(served: Client) -> None:
    with watching(served) as socket, pytest.raises(ConnectionClosed):
        read_all(socket, "x" * (100 << 20))
    assert alive(served)


def test_a_browser_that_never_reads_delays_no_other(served: Client, flown: Path) -> None:
    """Its samples wait in its own connection, in bounded room; another browser gets all, and the track is not touched."""
    shutil.copytree(flown, served.root / "run")
    track = served.root / "run" / "track.csv"
    lines = track.read_bytes().splitlines(keepends=True)
    rows = [line for line in lines if not line.startswith(b"#")][1:]
    with track.open("ab") as file:
        file.writelines(rows * 200)
    with watching(served) as slow, watching(served) as other:
        for _ in range(15):
            slow.send(json.dumps({"watch": "run", "from": 0}))
        other.send(json.dumps({"watch": "run", "from": 0}))
        got = 0
        while got < 201 * len(rows):
            message = json.loads(other.recv(timeout=WATCHDOG_S))
            got = message["from"] + len(message["samples"]) if "samples" in message else got
    assert track.stat().st_size == sum(map(len, lines)) + 200 * sum(map(len, rows))
    assert alive(served)


def test_a_run_folder_that_goes_away_while_it_is_open(served: Client, flown: Path) -> None:
    shutil.copytree(flown, served.root / "run")
    scene = served.get("/api/scene?name=run")
    with watching(served) as socket:
        socket.send(json.dumps({"watch": "run", "from": 0}))
        while "samples" not in json.loads(socket.recv(timeout=WATCHDOG_S)):
            pass
        shutil.rmtree(served.root / "run")
        for method, path, body in (
            ("GET", "/api/scene?name=run", None),
            ("GET", "/api/contours?name=run", None),
            ("GET", "/api/heights?name=run", None),
            ("GET", "/tiles/heights/8/1/1.png?name=run", None),
            ("POST", "/api/route/check", {"run": "run", "waypoints": scene["route"]}),
            ("POST", "/api/route/save", {"run": "run", "waypoints": scene["route"]}),
            ("POST", "/api/jobs", {"kind": "verify", "run": "run"}),
        ):
            status, _, raw = served.ask(method, path, body)
            assert status == 400, (path, status, raw)
            assert "run" in json.loads(raw)["error"]
        shutil.copytree(flown, served.root / "run")
        socket.send(json.dumps({"watch": "run", "from": 0}))
        while "samples" not in json.loads(socket.recv(timeout=WATCHDOG_S)):
            pass


def test_a_full_disk_is_one_line_at_every_button(
    served: Client, planned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(planned, served.root / "run")
    route = served.get("/api/scene?name=run")["route"]
    before = sorted(path.name for path in served.root.iterdir())

    def full(self: Path, *_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_text", full)
    form = {"name": "x", "area": "valley.geojson", "dem": [], "camera": "dji-m3e", "zones": []}
    for path, body in (
        ("/api/route/save", {"run": "run", "waypoints": route}),
        ("/api/jobs", {"kind": "verify", "run": "run"}),
        ("/api/scenarios", form),
    ):
        status, _, raw = served.ask("POST", path, body)
        assert status in (400, 507), (path, raw)
        assert len(json.loads(raw)["error"].splitlines()) == 1
    assert sorted(path.name for path in served.root.iterdir() if path.name != ".uavcover") == [
        n for n in before if n != ".uavcover"
    ]


def test_news_that_cannot_be_made_end_the_connection(
    served: Client, flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page connects anew, where it would wait for ever beside a connection without a sender."""
    shutil.copytree(flown, served.root / "run")

    async def broken(*_: object) -> None:
        raise KeyError("a fault")

    monkeypatch.setattr(server._Watcher, "_jobs", broken)
    with watching(served) as socket, pytest.raises(ConnectionClosed):
        read_all(socket)
    assert alive(served)
