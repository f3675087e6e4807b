"""What a mission's pictures would show, by ``uavcover check --area``, and the same counted without the package."""

import json
import math
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely

import uavcover
from tests.cli.conftest import Cli
from tests.naive.file_ground import FileGround
from tests.naive.mission_check import Plane
from tests.naive.photos import count
from tests.naive.plan_coverage import trigger

DATA = Path(uavcover.__file__).parent / "data"
DEM = DATA / "jacksboro.tif"
HOME = (36.4762, -84.2160)
CENTRE, RADIUS_M = (36.47735, -84.21485), 60.0
AREA = f"{CENTRE[0]},{CENTRE[1]},{RADIUS_M}"
EVERY_M, HEIGHT_M = 15.0, 80.0
FREE = ("--dem", DEM, "--return-height", "150m", "--max-height", "none")


def lines_over_the_area(count_of_lines: int = 8) -> list[tuple[float, float]]:
    positions = []
    for k in range(count_of_lines):
        lon = HOME[1] + 0.0001 + k * 0.0003
        ends = [(HOME[0] + 0.0003, lon), (HOME[0] + 0.0020, lon)]
        positions += ends if k % 2 == 0 else ends[::-1]
    return positions


def survey(file: Path, positions: list[tuple[float, float]], begin: str, end: str) -> Path:
    """Lines with one item after the first place and one after the last, as "command p1 p2 p3 p5"."""
    rows = [
        "QGC WPL 110",
        f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]}\t{HOME[1]}\t485\t1",
        "1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t70\t1",
    ]

    def deed(text: str) -> str:
        command, p1, p2, p3, p5 = text.split()
        return f"{len(rows) - 1}\t0\t2\t{command}\t{p1}\t{p2}\t{p3}\t0\t{p5}\t0\t0\t1"

    for number, (lat, lon) in enumerate(positions):
        rows.append(f"{len(rows) - 1}\t0\t3\t16\t0\t0\t0\t0\t{lat:.7f}\t{lon:.7f}\t{HEIGHT_M}\t1")
        if number == 0 and begin:
            rows.append(deed(begin))
    if end:
        rows.append(deed(end))
    rows.append(f"{len(rows) - 1}\t0\t2\t20\t0\t0\t0\t0\t0\t0\t0\t1")
    file.write_text("\n".join(rows) + "\n")
    return file


def naive_view(positions: list[tuple[float, float]], step_m: float = 4.0) -> dict[str, float]:
    """Share of the area seen, pictures of a point, ground sample distance: every picture against every place."""
    row = tomllib.loads((DATA / "cameras.toml").read_text())["dji-m3e"]
    across, along = (0.5 * side / row["focal_length_mm"] for side in row["sensor_mm"])
    camera = SimpleNamespace(
        fov_across_deg=2 * math.degrees(math.atan(across)), fov_along_deg=2 * math.degrees(math.atan(along)), pitch_deg=-90.0,
        heading_deg=None, max_incidence_deg=75.0, range_m=2000.0, pixels_across=row["pixels"][0],
    )  # fmt: skip
    plane, ground = Plane(*HOME), FileGround(DEM)

    def height(en: np.ndarray) -> np.ndarray:
        return ground.height_m(*plane.back(en[:, 0], en[:, 1]))

    alt = float(height(np.zeros((1, 2)))[0]) + HEIGHT_M
    route = [(*plane.to(*position), alt) for position in positions]
    eyes, headings = trigger(route, EVERY_M, step_m=0.05)
    middle = plane.to(*CENTRE)
    axis = np.arange(-RADIUS_M, RADIUS_M, step_m)
    east, north = (each.ravel() for each in np.meshgrid(axis, axis))
    inside = np.hypot(east, north) < RADIUS_M
    en = np.column_stack([east[inside] + middle[0], north[inside] + middle[1]])
    slopes = [(height(en + d) - height(en - d)) / 0.2 for d in (np.array([0.1, 0.0]), np.array([0.0, 0.1]))]
    normals = np.column_stack([-slopes[0], -slopes[1], np.ones(len(en))])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    yaws = np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))
    photos, best, _ = count(camera, height, eyes, yaws, np.column_stack([en, height(en)]), normals)
    shown = best[np.isfinite(best)]
    return {
        "taken": len(eyes), "seen": float((photos > 0).mean()), "median": float(np.median(photos)),
        "sample_m": float(np.median(shown)) if len(shown) else math.nan,
    }  # fmt: skip


@pytest.mark.parametrize("lines", [8, 2])
def test_the_view_equals_a_count_that_shares_nothing(cli: Cli, tmp_path: Path, lines: int) -> None:
    positions = lines_over_the_area(lines)
    file = survey(tmp_path / "m.waypoints", positions, f"206 {EVERY_M} 0 1 0", "206 0 0 0 0")
    ended = cli("check", file, *FREE, "--area", AREA, "--camera", "dji-m3e", "--json", code=0)
    reported, own = ended.document["view"], naive_view(positions)
    assert reported["pictures"] == pytest.approx(own["taken"], abs=1), "the naive trigger is up to 5 cm late each time"
    assert reported["coverage_fraction"] == pytest.approx(own["seen"], abs=0.01)
    assert reported["pictures_median"] == pytest.approx(own["median"], abs=1.0)
    assert reported["ground_sample_median_m"] == pytest.approx(own["sample_m"], rel=0.01)
    assert (reported["coverage_fraction"] < 0.9) == (lines == 2)


def test_a_camera_that_waits_for_a_condition_is_not_proved(cli: Cli, tmp_path: Path) -> None:
    file = survey(tmp_path / "m.waypoints", lines_over_the_area(3), f"206 {EVERY_M} 0 1 0", "206 0 0 0 0")
    rows = file.read_text().splitlines()
    rows.insert(4, rows[4].replace("\t206\t", "\t112\t"))
    file.write_text("\n".join(rows))
    ended = cli("check", file, *FREE, "--area", AREA, "--camera", "dji-m3e", "--json")
    assert [(one["kind"], one["items"]) for one in ended.document["findings"] if one["weight"] == "unknown"] == [
        ("pictures", [4, 4])
    ]


def test_too_little_is_a_finding_and_on_the_map(cli: Cli, tmp_path: Path) -> None:
    file = survey(tmp_path / "m.waypoints", lines_over_the_area(3), f"206 {EVERY_M} 0 1 0", "206 0 0 0 0")
    observed = tmp_path / "seen.geojson"
    ended = cli(
        "check", file, *FREE, "--area", AREA, "--camera", "dji-m3e", "--coverage", "0.98", "--overlap", "75/70", "--json",
        "--map", observed,
     code=1)  # fmt: skip
    assert [one["kind"] for one in ended.document["findings"] if one["weight"] == "breaks"] == ["coverage", "overlap"]
    (unobserved,) = [
        each for each in json.loads(observed.read_text())["features"] if each["properties"].get("kind") == "unseen"
    ]
    plane = Plane(*HOME)
    shape = shapely.transform(
        shapely.geometry.shape(unobserved["geometry"]), lambda xy: np.array([plane.to(y, x) for x, y in xy])
    )
    missing = 1.0 - ended.document["view"]["coverage_fraction"]
    assert shape.area == pytest.approx(missing * math.pi * RADIUS_M**2, rel=0.05)


@pytest.mark.parametrize(
    ("begin", "end", "options", "photos"),
    [
        ("", "", (), 0),
        ("206 15 0 1 0", "206 0 0 0 0", ("--gsd", "0.5cm"), 27),
        ("", "", ("--picture-every", "15m"), 29),
        ("2000 0 2 0 0", "2001 0 0 0 0", ("--speed", "10m/s"), 21),
        ("2000 0 0 1 0", "203 0 0 0 1", (), 2),
    ],
)
def test_whatever_takes_the_pictures(
    cli: Cli, tmp_path: Path, begin: str, end: str, options: tuple[str, ...], photos: int
) -> None:
    file = survey(tmp_path / "m.waypoints", lines_over_the_area(2), begin, end)
    ended = cli("check", file, *FREE, "--area", AREA, "--camera", "dji-m3e", "--json", *options)
    assert ended.document["view"]["pictures"] == pytest.approx(photos, abs=1)
    assert (ended.code == 1) == (photos == 0)
    if "--gsd" in options:
        assert ended.document["view"]["coverage_fraction"] == 0.0


def test_a_camera_that_is_too_slow(cli: Cli, tmp_path: Path) -> None:
    file = survey(tmp_path / "m.waypoints", lines_over_the_area(2), "206 3 0 1 0", "206 0 0 0 0")
    ended = cli("check", file, *FREE, "--area", AREA, "--camera", "dji-m3e", "--speed", "10m/s", "--json")
    (slow,) = [one for one in ended.document["findings"] if one["kind"] == "pictures"]
    assert slow["by"] == pytest.approx(0.4, abs=0.01), "a picture every 0.3 s, and the camera needs 0.7 s"
    assert ended.code == 1


@pytest.mark.parametrize(
    ("options", "telling"),
    [
        (("--area", AREA), "--camera"),
        (("--camera", "dji-m3e"), "--area"),
        (("--area", AREA, "--camera", "box"), "box"),
        (("--area", "no.kml", "--camera", "dji-m3e"), "no.kml"),
        (("--area", "10,10,50", "--camera", "dji-m3e"), "swapped"),
        (("--area", AREA, "--camera", "dji-m3e", "--coverage", "98"), "--coverage"),
        (("--area", AREA, "--camera", "dji-m3e", "--coverage", "nan"), "--coverage"),
        (("--area", AREA, "--camera", "dji-m3e", "--overlap", "a"), "a"),
        (("--area", AREA, "--camera", "dji-m3e", "--picture-every", "2"), "--picture-every"),
        (("--area", AREA, "--camera", "dji-m3e", "--camera-pitch", "30"), "--camera-pitch"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, tmp_path: Path, options: tuple[str, ...], telling: str) -> None:
    file = survey(tmp_path / "m.waypoints", lines_over_the_area(1), "", "")
    assert telling in cli("check", file, *FREE, *options, code=2).error
