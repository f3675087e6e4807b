"""A map of the user's own behind the report's: every pixel lies where the file has it, and bad files are one line."""

import contextlib
import io
import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from pyproj import Transformer
from rasterio.transform import Affine

from tests.report.browser import Page
from tests.report.conftest import HOSTILE, coarse
from tests.report.test_in_browser import check_quiet
from tests.report.test_page import Elements
from uavcover.errors import InputError
from uavcover.report import background
from uavcover.report.background import read_background
from uavcover.report.content import ReportContent, bounds_m
from uavcover.report.page import render_report
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site

Extent = tuple[float, float, float, float]


def extent_of(site: Site, pad_deg: float = 0.004) -> Extent:
    """West, south, east, north of the map in degrees, with a margin."""
    west, south, east, north = bounds_m(site)
    assert site.frame is not None
    lat, lon, _ = site.frame.geodetic_from_enu(np.array([[e, n, 300.0] for e in (west, east) for n in (south, north)]))
    return lon.min() - pad_deg, lat.min() - pad_deg, lon.max() + pad_deg, lat.max() + pad_deg


def colors(extent: Extent, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """A colour for every place: red grows to the east, green to the north."""
    west, south, east, north = extent
    red, green = 250.0 * (lon - west) / (east - west), 250.0 * (lat - south) / (north - south)
    return np.stack([red, green, np.full_like(red, 77.0)], axis=-1)


def write_geotiff(
    path: Path, extent: Extent, epsg: int, *, turn_deg: float = 0.0, bands: int = 3, **options: Any
) -> Path:
    to_file = Transformer.from_crs(4326, epsg, always_xy=True)
    west, south, east, north = to_file.transform_bounds(*extent)
    transform = Affine((east - west) / 500, 0.0, west, 0.0, (south - north) / 420, north)
    if turn_deg:
        about = Affine.rotation(turn_deg) @ Affine.scale(1.4)
        transform = transform @ Affine.translation(250, 210) @ about @ Affine.translation(-250, -210)
    column, row = np.meshgrid(np.arange(500) + 0.5, np.arange(420) + 0.5)
    x = transform.a * column + transform.b * row + transform.c
    y = transform.d * column + transform.e * row + transform.f
    lon, lat = to_file.transform(x, y, direction="INVERSE")
    pixels = np.clip(colors(extent, lon, lat), 0.0, 255.0).round().astype(np.uint8)
    tags = options.pop("tags", {})
    profile = {"dtype": "uint8", "crs": f"EPSG:{epsg}", "transform": transform, **options}
    with rasterio.open(path, "w", driver="GTiff", width=500, height=420, count=bands, **profile) as file:
        for band in range(bands):
            values = pixels[..., band] if band < 3 else np.where(column > 300, 0, 255)
            file.write(values.astype(profile["dtype"]), band + 1)
        file.update_tags(**tags)
    return path


def write_mbtiles(
    path: Path,
    extent: Extent,
    *,
    zooms: tuple[int, ...] = (13, 14, 15),
    pixels: int = 256,
    kind: str = "PNG",
    leave_out: Callable[[int, int, int], bool] = lambda *_: False,
    **facts: str,
) -> Path:
    to_mercator = Transformer.from_crs(4326, 3857, always_xy=True)
    half = math.pi * 6378137.0
    west, south, east, north = to_mercator.transform_bounds(*extent)
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        file.execute("CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB)")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", kind.lower()), *facts.items()])
        for zoom in zooms:
            side = 2.0 * half / 2**zoom
            for column in range(math.floor((west + half) / side), math.floor((east + half) / side) + 1):
                for row in range(math.floor((south + half) / side), math.floor((north + half) / side) + 1):
                    if leave_out(zoom, column, row):
                        continue
                    x = -half + (column + (np.arange(pixels) + 0.5) / pixels) * side
                    y = -half + (row + 1 - (np.arange(pixels) + 0.5) / pixels) * side
                    lon, lat = to_mercator.transform(*np.meshgrid(x, y), direction="INVERSE")
                    image = Image.fromarray(np.clip(colors(extent, lon, lat), 0, 255).round().astype(np.uint8))
                    out = io.BytesIO()
                    image.save(out, kind)
                    file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (zoom, column, row, out.getvalue()))
    file.close()
    return path


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The pictures before they are packed, which costs colours."""
    kept: list[np.ndarray] = []
    pack = background.data_uri

    def keep(pixels: np.ndarray, kind: str, **options: object) -> str:
        kept.append(pixels)
        return pack(pixels, kind, **options)

    monkeypatch.setattr(background, "data_uri", keep)
    return kept


def check_positions(site: Site, pixels: np.ndarray, extent: Extent, tolerance: float = 2.0) -> None:
    west, south, east, north = bounds_m(site)
    rng = np.random.default_rng(2)
    rows, columns = pixels.shape[:2]
    row, column = rng.integers(0, rows, 400), rng.integers(0, columns, 400)
    e, n = west + (column + 0.5) / columns * (east - west), north - (row + 0.5) / rows * (north - south)
    assert site.frame is not None
    lat, lon, _ = site.frame.geodetic_from_enu(np.column_stack([e, n, np.full(400, 250.0)]))
    shown = pixels[row, column]
    opaque = shown[:, 3] == 255
    assert opaque.any()
    np.testing.assert_allclose(shown[opaque, :3], colors(extent, lon, lat)[opaque], atol=tolerance)
    assert max(rows, columns) == background.BACKGROUND.pixels
    assert rows / columns == pytest.approx((north - south) / (east - west), rel=0.01)


@pytest.mark.parametrize("turn_deg", [0.0, 25.0])
@pytest.mark.parametrize("epsg", [4326, 32616, 3857, 6576, 5070])
def test_every_pixel_of_a_geotiff_lies_where_it_is(
    site: Site, tmp_path: Path, drawn: list[np.ndarray], epsg: int, turn_deg: float
) -> None:
    extent = extent_of(site)
    path = write_geotiff(
        tmp_path / "map.tif", extent, epsg, turn_deg=turn_deg, tags={"TIFFTAG_COPYRIGHT": "A. Surveyor"}
    )
    found = read_background(path, site, bounds_m(site))
    assert found.attribution == "A. Surveyor"
    assert found.image.startswith("data:image/webp;base64,")
    check_positions(site, drawn[0], extent)
    assert (drawn[0][..., 3] == 255).mean() > (0.5 if turn_deg else 0.999)


@pytest.mark.parametrize(
    ("zooms", "pixels", "kind"), [((13, 14, 15), 256, "PNG"), ((15,), 512, "JPEG"), ((10, 12), 256, "WEBP")]
)
def test_every_pixel_of_mbtiles_lies_where_it_is(
    site: Site, tmp_path: Path, drawn: list[np.ndarray], zooms: tuple[int, ...], pixels: int, kind: str
) -> None:
    extent = extent_of(site)
    path = write_mbtiles(
        tmp_path / "map.mbtiles", extent, zooms=zooms, pixels=pixels, kind=kind,
        attribution='<a href="https://example.org">&copy; Makers</a> of  maps',
    )  # fmt: skip
    before = path.read_bytes()
    found = read_background(path, site, bounds_m(site))
    assert found.attribution == "© Makers of maps"
    # A pixel of the coarsest zoom is some metres.
    check_positions(site, drawn[0], extent, tolerance=2.0 if zooms[-1] > 13 and kind == "PNG" else 9.0)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_what_the_file_does_not_have_is_transparent(site: Site, tmp_path: Path, drawn: list[np.ndarray]) -> None:
    extent = extent_of(site)
    west, south, east, north = extent
    half = (west, south, (west + east) / 2.0, north)
    read_background(write_geotiff(tmp_path / "half.tif", half, 4326), site, bounds_m(site))
    read_background(write_geotiff(tmp_path / "alpha.tif", extent, 4326, bands=4), site, bounds_m(site))
    missing = write_mbtiles(tmp_path / "some.mbtiles", extent, zooms=(15,), leave_out=lambda _, c, r: (c + r) % 2 == 0)
    read_background(missing, site, bounds_m(site))
    grey = write_geotiff(tmp_path / "grey.tif", extent, 32616, bands=1, nodata=0)
    read_background(grey, site, bounds_m(site))
    for pixels in drawn[:3]:
        assert 0.2 < (pixels[..., 3] == 0).mean() < 0.8
    assert (drawn[3][..., 0] == drawn[3][..., 1]).all()
    check_positions(site, np.dstack([drawn[0]]), half)


def test_a_palette_shows_its_colours(site: Site, tmp_path: Path, drawn: list[np.ndarray]) -> None:
    path = write_geotiff(tmp_path / "palette.tif", extent_of(site), 4326, bands=1)
    with rasterio.open(path, "r+") as file:
        file.write(np.full((420, 500), 9, dtype=np.uint8), 1)
        file.write_colormap(1, {9: (10, 200, 30, 255)})
    read_background(path, site, bounds_m(site))
    assert (drawn[0] == [10, 200, 30, 255]).all()


def _broken_tile(path: Path, site: Site, data: object) -> Path:
    write_mbtiles(path, extent_of(site), zooms=(14,))
    with sqlite3.connect(path) as file:
        file.execute("UPDATE tiles SET tile_data = ?", (data,))
    file.close()
    return path


def _png(width: int, height: int) -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (width, height)).save(out, "PNG")
    return out.getvalue()


def _sql(path: Path, *statements: str) -> Path:
    with sqlite3.connect(path) as file:
        for statement in statements:
            file.execute(statement)
    file.close()
    return path


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


TABLES = (
    "CREATE TABLE metadata (name, value)",
    "CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)",
)
FAR = (8.0, 46.0, 8.1, 46.1)
VRT = b'<VRTDataset rasterXSize="10" rasterYSize="10"><SRS>EPSG:4326</SRS></VRTDataset>'
BAD: dict[str, tuple[Callable[[Path, Site], Path], str]] = {
    "nothing": (lambda f, _: f / "no.tif", "no such file"),
    "a folder": (lambda f, _: f, "no such file"),
    "empty": (lambda f, _: _written(f / "a.tif", b""), "cannot read the file as GeoTIFF or MBTiles"),
    "text": (lambda f, _: _written(f / "a.tif", b"hello"), "cannot read the file as GeoTIFF or MBTiles"),
    "a picture without a place": (lambda f, _: _written(f / "a.png", _png(64, 64)), "cannot read the file as GeoTIFF"),
    "a file that names others": (lambda f, _: _written(f / "a.vrt", VRT), "cannot read the file as GeoTIFF"),
    "cut off": (
        lambda f, s: _written(f / "cut.tif", write_geotiff(f / "w.tif", extent_of(s), 4326).read_bytes()[:3000]),
        "cannot read",
    ),
    "no system": (lambda f, s: write_geotiff(f / "a.tif", extent_of(s), 4326, crs=None), "has no coordinate system"),
    "heights": (lambda f, s: write_geotiff(f / "a.tif", extent_of(s), 4326, bands=1, dtype="float32"), "not 8 bits"),
    "16 bits": (lambda f, s: write_geotiff(f / "a.tif", extent_of(s), 4326, dtype="uint16"), "gdal_translate -ot Byte"),
    "elsewhere": (lambda f, _: write_geotiff(f / "a.tif", FAR, 4326), "does not cover the map"),
    "elsewhere, tiles": (lambda f, _: write_mbtiles(f / "a.mbtiles", FAR, zooms=(12,)), "does not cover the map"),
    "no tables": (lambda f, _: _sql(f / "a.mbtiles", "CREATE TABLE other (a)"), "no such table"),
    "no tiles": (lambda f, _: _sql(f / "a.mbtiles", *TABLES), "contains no tiles"),
    "vectors": (lambda f, _: write_mbtiles(f / "a.mbtiles", FAR, zooms=(3,), kind="PNG") and _sql(
        f / "a.mbtiles", "UPDATE metadata SET value = 'pbf' WHERE name = 'format'"), "vector tiles"),
    "a tile of text": (lambda f, s: _broken_tile(f / "a.mbtiles", s, b"hello"), "(zoom, column, row) cannot be read"),
    "a tile of words": (lambda f, s: _broken_tile(f / "a.mbtiles", s, "hello"), "is not an image"),
    "an oblong tile": (lambda f, s: _broken_tile(f / "a.mbtiles", s, _png(256, 128)), "not a square"),
    "a huge tile": (lambda f, s: _broken_tile(f / "a.mbtiles", s, _png(4096, 4096)), "not a square of 64 to 2048"),
    "fine tiles only": (lambda f, _: _sql(
        f / "a.mbtiles", *TABLES, "INSERT INTO tiles VALUES (22, 1, 1, x'00')"), "lowest zoom has too many tiles"),
    "a broken database": (lambda f, _: _written(f / "a.mbtiles", b"SQLite format 3\0" + b"x" * 5000), "cannot read"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_a_bad_file_is_one_line(site: Site, tmp_path: Path, what: str) -> None:
    make, words = BAD[what]
    path = make(tmp_path, site)
    with pytest.raises(InputError) as caught:
        read_background(path, site, bounds_m(site))
    assert str(caught.value).startswith(f"--background: {path}: ")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(12))
def test_no_damage_leaves_a_trace(site: Site, tmp_path: Path, seed: int) -> None:
    """Bytes changed, cut out or put in anywhere: the file is read, or the error is one line."""
    rng = np.random.default_rng(seed)
    extent = extent_of(site)
    kind = seed % 2
    path = (
        write_mbtiles(tmp_path / "a.mbtiles", extent, zooms=(13,))
        if kind
        else write_geotiff(tmp_path / "a.tif", extent, 4326)
    )
    content = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 30))):
        at = int(rng.integers(0, min(len(content), 4000 if rng.random() < 0.5 else len(content))))
        content[at : at + int(rng.integers(0, 9))] = rng.bytes(int(rng.integers(0, 9)))
    path.write_bytes(bytes(content))
    reported = f"--background: {path}: "
    with contextlib.suppress(InputError):
        try:
            read_background(path, site, bounds_m(site))
        except InputError as error:
            reported = str(error)
            raise
    assert reported.startswith(f"--background: {path}: ")
    assert "\n" not in reported


def test_a_scenario_without_a_place_on_earth_has_no_background(tmp_path: Path) -> None:
    nowhere = coarse("paper-R2", 0.5, limits=load_scenario("paper-R2").limits)
    with pytest.raises(InputError, match="no position on Earth"):
        read_background(tmp_path, nowhere, (0.0, 0.0, 10.0, 10.0))


def test_the_page_shows_it_and_its_makers_as_text(
    page: Page, site: Site, content: ReportContent, tmp_path: Path
) -> None:
    path = write_geotiff(tmp_path / "map.tif", extent_of(site), 4326, tags={"ATTRIBUTION": f"Makers {HOSTILE} & Co"})
    html = render_report(content, read_background(path, site, bounds_m(site)))
    assert "Background: map.tif, Makers" in Elements(html).text
    assert len(html) < len(render_report(content)) + 400_000
    (tmp_path / "report.html").write_text(html)
    page.open(tmp_path / "report.html")
    assert page.run("window.hacked ?? null") is None
    assert page.run("document.querySelector('#map img.background').naturalWidth") > 1000
    order = "['', '.background', '.cells'].map(c => Number(getComputedStyle(document.querySelector('#map img' + c)).zIndex))"
    assert page.run(order) == [1, 2, 3]
    number = page.run(
        "[...document.querySelectorAll('.leaflet-control-layers-overlays label')]"
        ".findIndex(l => l.textContent.includes('Background'))"
    )
    page.run(f"document.querySelectorAll('.leaflet-control-layers-overlays input')[{number}].click()")
    assert page.run("document.querySelector('#map img.background')") is None
    check_quiet(page)
