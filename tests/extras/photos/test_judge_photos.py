"""``judge-photos``: pictures of a planned flight, with and without some of them, and what cannot be judged."""

import csv
import json

import numpy as np
import pytest
import rasterio

from tests.extras.photos.camera_files import dji, write_jpeg
from uavcover.extras.photos.any_flight import evidence_for_flight
from uavcover.extras.photos.photo import Photo
from uavcover.extras.photos.photo_judgement import PhotoRequest, judged
from uavcover.extras.photos.photo_verdict import photo_raster, photo_table
from uavcover.extras.photos.placing import Assumptions
from uavcover.extras.photos.readers import PhotoSet
from uavcover.model.verdict import combined
from uavcover.new.command import new_scenario
from uavcover.new.elevation_questions import NewRequest
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended
from uavcover.scenario.areas.area_file import AreaQuery
from uavcover.scenario.site import area_as_drawn, load_site
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.run_logs import read_planned_route

AREA = "36.4762,-84.2160,45"
DEM = "uavcover/data/jacksboro.tif"


def shots(site, route):
    """Where pictures are taken on a route, as name, latitude, longitude, height, yaw and seconds."""
    looks = judging_map(site).observations(route.waypoints_m)
    lat, lon, alt = site.frame.geodetic_from_enu(looks.positions_m)
    yaw = np.degrees(np.arctan2(looks.headings[:, 0], looks.headings[:, 1]))
    return list(zip(lat, lon, alt, yaw, 2 * np.arange(len(looks)), strict=True))


def take(folder, photos, *, prefix="DJI"):
    folder.mkdir(exist_ok=True)
    for number, (lat, lon, alt, yaw, time_s) in enumerate(photos):
        reported = dji(
            AbsoluteAltitude=f"{alt:+.3f}", RelativeAltitude="+80.0", GimbalYawDegree=f"{yaw:.2f}",
            GimbalPitchDegree="-90.00", GimbalRollDegree="+0.00", FlightXSpeed="8.0", FlightYSpeed="0.0",
        )  # fmt: skip
        moment = f"2026:05:04 {10 + time_s // 3600:02d}:{time_s // 60 % 60:02d}:{time_s % 60:02d}"
        write_jpeg(
            folder / f"{prefix}_{number:04d}.JPG",
            position=(lat, lon),
            alt_m=alt,
            time=moment,
            xmp=reported,
            pixels=(5280, 3956),
        )


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The pictures of a survey of plain lines."""
    request = NewRequest(
        area=AreaQuery(source=AREA), dem=(DEM,), camera="dji-m3e", gsd="2.5cm", overlap="75/70", home="36.4770,-84.2172"
    )
    site = new_scenario(request, Unattended(), folder=tmp_path_factory.mktemp("scenario")).site
    return shots(site, fly_layout(site, plain_boustrophedon(site)))


REQUIRED = ("--area", AREA, "--dem", DEM, "--camera", "dji-m3e", "--gsd", "2.5cm", "--overlap", "75/70")


def test_a_whole_survey_passes_and_says_what_is_shown(cli, tmp_path, flown):
    take(tmp_path / "DCIM", flown)
    reported = cli("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--json", code=0).document
    assert reported["passed"]
    assert reported["counted"] == len(flown)
    assert reported["missing_photos"] == []
    assert reported["overlap_fraction"] >= 0.99
    assert reported["coverage_holds"] == "yes"
    assert reported["refly"] is None
    rows = list(csv.DictReader((tmp_path / "out/pictures.csv").read_text().splitlines()))
    assert len(rows) == len(flown)
    assert float(rows[3]["lat_deg"]) == pytest.approx(flown[3][0], abs=2e-7)
    # A pixel is 1.9 cm wide at 80 m: 8 mm of motion in a millisecond at 8 m/s.
    assert float(rows[3]["blur_px"]) == pytest.approx(0.008 * 3751.0 / float(rows[3]["height_agl_m"]), rel=0.02)
    prints = json.loads((tmp_path / "out/footprints.geojson").read_text())
    assert len(prints["features"]) == len(flown)
    with rasterio.open(tmp_path / "out/photos.tif") as raster:
        assert raster.descriptions[0] == "pictures"
        assert np.nanmin(raster.read(1)) >= 0


def test_what_is_missing_is_told_and_the_flight_for_it_makes_it_whole(cli, tmp_path, flown):
    third = len(flown) // 3
    take(tmp_path / "DCIM", flown)
    for number in range(third, 2 * third):
        (tmp_path / f"DCIM/DJI_{number:04d}.JPG").unlink()
    ended = cli(
        "judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--budget", "1s", "--json", code=1
    )
    reported = ended.document
    assert reported["verdict"] == "failed"
    assert reported["overlap_holds"] is False
    (stretch,) = reported["missing_photos"]
    assert (stretch["after"], stretch["before"]) == (f"DJI_{third - 1:04d}.JPG", f"DJI_{2 * third:04d}.JPG")
    lines = [feature for feature in json.loads((tmp_path / "out/gaps.geojson").read_text())["features"]
             if feature["properties"]["reason"] == "photos-missing"]  # fmt: skip
    assert [feature["geometry"]["type"] for feature in lines] == ["LineString"]
    assert {gap["reason"] for gap in reported["gaps"]} <= {"too-few-looks", "never-in-range", "too-coarse"}
    lacking_m2 = (1.0 - reported["overlap_fraction"]) * reported["area_m2"]
    assert 0.99 * lacking_m2 < sum(gap["area_m2"] for gap in reported["gaps"]) < reported["area_m2"]
    again = tmp_path / "out/refly"
    planned = read_planned_route(RunFolder(again))
    assert planned is not None
    site = load_site(again / "scenario.toml")
    drawn_m2 = area_as_drawn(site).area
    assert reported["refly"]["missing_m2"] <= drawn_m2 < 1.6 * reported["refly"]["missing_m2"]
    take(tmp_path / "DCIM", shots(site, planned), prefix="AGAIN")
    both = cli("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "both", "--no-refly", "--json")
    assert both.document["overlap_fraction"] >= 0.98


def test_without_camera_and_sample_distance_the_pictures_tell_both(cli, tmp_path, flown):
    take(tmp_path / "DCIM", flown)
    ended = cli(
        "judge-photos",
        tmp_path / "DCIM",
        "--area",
        AREA,
        "--dem",
        DEM,
        "-o",
        tmp_path / "out",
        "--no-refly",
        "--json",
        code=0,
    )
    assert (tmp_path / "out/camera.toml").read_text().count("12.29") == 2
    assert ended.document["overlap_holds"] is None
    folders = tmp_path / "DCIM", "--scenario", tmp_path / "out", "-o", tmp_path / "two"
    assert cli("judge-photos", *folders, "--no-refly", "--json").document["counted"] == len(flown)


def table_of(folder, flown):
    """The same pictures as a table, which is quicker to write."""
    path = folder / "list.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "lat", "lon", "alt", "yaw", "pitch"])
        writer.writerows([f"{k:04d}", lat, lon, alt, yaw, -90.0] for k, (lat, lon, alt, yaw, _) in enumerate(flown))
    return path


def bands(flown, *, files, apart_m, rng):
    """Each photo as some files, their places up to so many metres apart, and up to 1 s."""
    for lat, lon, alt, yaw, time_s in flown:
        for file in range(files):
            east, north = apart_m * rng.uniform(-1.0, 1.0, 2)
            yield lat + north / 111_000.0, lon + east / 89_000.0, alt, yaw, time_s + file % 2


ONE_LOOK = {
    "bands 3 cm apart": (6, 0.03),
    "a burst": (6, 0.5),
    "hovering": (6, 2.0),
}


@pytest.mark.parametrize("kind", ONE_LOOK)
def test_photos_that_are_one_look_make_no_overlap(cli, tmp_path, flown, kind):
    files, apart_m = ONE_LOOK[kind]
    few = list(bands(flown[::4], files=files, apart_m=apart_m, rng=np.random.default_rng(3)))
    ended = cli(
        "judge-photos", table_of(tmp_path, few), *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--json", code=1
    )
    reported = ended.document
    assert (reported["counted"], reported["looks"]) == (len(few), len(flown[::4]))
    assert reported["overlap_fraction"] < 0.1
    assert "are one look" in ended.err


def test_files_of_one_capture_are_one_look(cli, tmp_path, flown):
    """ODM's list names the capture of each file; its bands are up to 1 s, here 8 m, apart."""
    rows = [
        {"filename": f"{k}_{band}.tif", "latitude": lat, "longitude": lon + 8.0 * band / 2 / 89_000.0, "altitude": alt,
         "yaw": yaw, "pitch": 0.0, "roll": 0.0, "capture_uuid": f"capture-{k}"}
        for k, (lat, lon, alt, yaw, _) in enumerate(flown[::4]) for band in range(3)
    ]  # fmt: skip
    (tmp_path / "images.json").write_text(json.dumps(rows))
    ended = cli(
        "judge-photos", tmp_path / "images.json", *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--json", code=1
    )
    assert ended.document["looks"] == len(flown[::4])


def test_every_band_of_a_whole_survey_passes(cli, tmp_path, flown):
    whole = list(bands(flown, files=3, apart_m=0.03, rng=np.random.default_rng(3)))
    ended = cli(
        "judge-photos", table_of(tmp_path, whole), *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--json", code=0
    )
    assert ended.document["looks"] == len(flown)


@pytest.mark.parametrize(("required", "code"), [("0.3", 0), ("0.999", 1)])
def test_a_search_is_judged_by_its_probability_of_detection(cli, tmp_path, flown, required, code):
    (tmp_path / "ball.toml").write_text("target_m = 0.04\npixels_for_half = 2\nhidden_from_above = 0.2")
    options = (*REQUIRED, "-o", tmp_path / "out", "--no-refly", "--report", tmp_path / "out.html")
    search = ("--detection", tmp_path / "ball.toml", "--pod", required)
    ended = cli("judge-photos", table_of(tmp_path, flown), *options, *search, "--json")
    assert ended.code == code, ended.err
    reported = ended.document["detection"]
    assert reported["holds"] is (code == 0)
    assert ended.document["verdict"] == ("passed" if code == 0 else "failed")
    assert reported["pod_best_look"] == reported["pod"] < reported["pod_every_picture"]  # all from above
    assert 0.35 < reported["pod_best_look"] < 0.5  # 2 cm a pixel: half of 0.8
    with rasterio.open(tmp_path / "out/photos.tif") as raster:
        assert raster.descriptions[-1] == "pod"
        pod = raster.read(raster.count)
    assert np.nanpercentile(pod, 50) == pytest.approx(reported["pod_percentiles"]["50"], abs=0.02)
    assert np.nanmean(pod) == pytest.approx(reported["pod"], abs=0.02)
    assert ("NOT MET" in ended.err) is (code == 1)
    page = (tmp_path / "out.html").read_text()
    assert "Probability of detection, mean over the area (ball)" in page
    assert '"Probability of detection"' in page


def test_a_search_needs_to_know_how_fine_pictures_are(cli, tmp_path, flown):
    options = ("--scenario", "docs/examples/search.toml", "--detection", "person", "-o", tmp_path / "out")
    ended = cli("judge-photos", table_of(tmp_path, flown[:4]), *options, code=2)
    assert "the scenario's sensor has no pixels_across" in ended.error


def test_the_curves_of_the_package_are_listed(cli):
    ended = cli("judge-photos", "--detection", "list", "--json", code=0)
    assert ended.document["curves"] == ["person", "person-recognised"]


@pytest.mark.parametrize(
    ("blurred", "reported", "verdict"),
    [
        ({}, {0, 1, 2}, "passed"),
        ({0, 1, 2}, {0, 1, 2}, "failed"),
        ({1, 2}, {0, 1, 2}, "failed"),
        ({}, {0}, "not proved"),
        ({1, 2}, {1, 2}, "failed"),
        ({}, {}, "not proved"),
    ],
    ids=["sharp", "all", "two of three", "unknown", "unknown does not help", "all unknown"],
)
def test_pictures_that_are_blurred_or_may_be_do_not_count(flown, tmp_path, blurred, reported, verdict):
    """Which of three pictures in turn are blurred, and which tell their exposure."""
    request = NewRequest(area=AreaQuery(source=AREA), dem=(DEM,), camera="dji-m3e", gsd="2.5cm", overlap="75/70")
    site = new_scenario(request, Unattended(), folder=tmp_path).site
    photos = tuple(
        Photo(
            name=f"p{k}", lat_deg=lat, lon_deg=lon, alt_m=alt, yaw_deg=yaw, pitch_deg=-90.0,
            speed_m_s=8.0, exposure_s=(0.01 if k % 3 in blurred else 0.001) if k % 3 in reported else None,
        )
        for k, (lat, lon, alt, yaw, _) in enumerate(flown)
    )  # fmt: skip
    required = PhotoRequest(
        photos=(), area=request, scenario=None, assumed=Assumptions(), takeoff=None, coverage=0.98, mount_known=True,
        refly=False, budget_s=None, force=False, max_blur_px=1.0,
    )  # fmt: skip
    found = judged(required, PhotoSet(photos, ()), site, Unattended())
    assert found.document["verdict"] == verdict
    assert found.document["passed"] is (verdict == "passed")
    evidence = evidence_for_flight(found)
    assert combined(each.effect for each in evidence.findings) == found.judgement.verdict == verdict
    counting = [k for k in range(len(flown)) if k % 3 in reported and k % 3 not in blurred]
    assert [photo.name for photo in found.placed.photos] == [f"p{k}" for k in counting]
    assert found.too_blurred == sum(k % 3 in reported and k % 3 in blurred for k in range(len(flown)))
    # 1.9 cm a pixel at 80 m and 8 m/s: 4 pixels in 10 ms.
    assert all(why.startswith(("blurred by 4.", "blurred by 3.", "the blur")) for why in found.placed.left_out.values())
    photo_raster(found)
    assert len(photo_table(found, site).splitlines()) == 1 + len(flown)


def test_heights_that_do_not_fit_are_doubted(cli, tmp_path, flown):
    take(
        tmp_path / "DCIM", [(lat, lon, alt - 60.0 * (k % 2), yaw, t) for k, (lat, lon, alt, yaw, t) in enumerate(flown)]
    )
    assert cli("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--no-refly").code in (0, 1)
    take(tmp_path / "DCIM", [(lat, lon, alt - 200.0, yaw, t) for lat, lon, alt, yaw, t in flown])
    ended = cli("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--force")
    assert "photos are below ground" in ended.err
    assert ended.code == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "specify either --area"),
        (("--area", AREA, "--scenario", "x.toml"), "specify either --area"),
        (("--scenario", "jacksboro", "--gsd", "2cm"), "--gsd requires --area"),
        (("--area", AREA), "--dem"),
        (("--area", AREA, "--dem", DEM, "--coverage", "98"), "--coverage: must be above 0 and at most 1, not 98"),
        (("--area", AREA, "--dem", DEM, "--angle-error", "-1"), "--angle-error"),
        (("--area", AREA, "--dem", DEM, "--takeoff", "0,0"), "--takeoff: 0, 0 is outside"),
        (("--area", AREA, "--dem", DEM, "--camera", "dji-m3m-multispectral"), "no photo was taken with this camera"),
        (("--area", "46.0,8.0,60", "--dem", DEM), "46"),
        (("--area", AREA, "--dem", DEM, "--max-blur", "0"), "--max-blur: 0 is out of range"),
        (("--area", AREA, "--dem", DEM, "--pod", "0.8"), "--pod: this option requires --detection"),
        (("--area", AREA, "--dem", DEM, "--pod", "80", "--detection", "person"), "--pod: 80 is not a probability"),
        (("--area", AREA, "--dem", DEM, "--pod", "nan", "--detection", "person"), "--pod: nan is not a probability"),
        (("--area", AREA, "--dem", DEM, "--detection", "dog"), "--detection: unknown name 'dog'"),
        (("--area", AREA, "--dem", DEM, "--detection", "no.toml"), "cannot read no.toml"),
    ],
)
def test_what_cannot_be_judged_is_one_line(cli, tmp_path, flown, options, words):
    take(tmp_path / "DCIM", flown[:4])
    ended = cli("judge-photos", tmp_path / "DCIM", *options, "-o", tmp_path / "out", code=2)
    assert words in ended.err.splitlines()[-1]
    assert "Traceback" not in ended.err
    assert not (tmp_path / "out/photos.json").exists()


def test_photos_of_a_second_camera_are_named(cli, tmp_path, flown):
    take(tmp_path / "DCIM", flown[:12])
    for number, (lat, lon, alt, _, _) in enumerate(flown[12:15]):
        write_jpeg(
            tmp_path / f"DCIM/P1_{number}.jpg", position=(lat, lon), alt_m=alt, model=("DJI", "P1"), pixels=(8192, 5460)
        )
    ended = cli(
        "judge-photos", tmp_path / "DCIM", "--area", AREA, "--dem", DEM, "--no-refly", "-o", tmp_path / "out", "--json"
    )
    assert "3 photos are from other cameras (DJI P1) and not counted; judge each camera separately" in ended.err
    assert ended.err.count("the minimum photo interval of") == 1
    assert ended.document["counted"] == 12


def test_photos_without_places_say_what_to_give(cli, tmp_path):
    write_jpeg(tmp_path / "DCIM_0001.jpg")
    ended = cli("judge-photos", tmp_path, "--area", AREA, "--dem", DEM, "-o", tmp_path / "out", code=2)
    assert "no position); add a list of their positions (geo.txt, .csv, .MRK or the flight's log)" in ended.err


@pytest.mark.parametrize("gsd", [(), ("--gsd", "2.5cm")])
def test_swapped_axes_are_asked_about(cli, tmp_path, gsd):
    (tmp_path / "list.csv").write_text("name,lat,lon,alt,yaw,pitch\na,-84.216,36.476,560,0,-90\n")
    options = ("--area", AREA, "--dem", DEM, "--camera", "dji-m3e", *gsd, "-o", tmp_path / "out")
    ended = cli("judge-photos", tmp_path / "list.csv", *options, code=2)
    assert "are latitude and longitude swapped" in ended.err.splitlines()[-1]


FAULTS = {
    "another lens": ({"film_mm": 162, "focal_mm": 29.9}, "its focal length corresponds to 162 mm on 35 mm film"),
    "a crop": ({"pixels": (5280, 1500)}, "5280 x 1500 pixels: the photo is cropped"),
    "another camera": ({"pixels": (4000, 3000)}, "4000 x 3000 pixels: the photo is from a different camera"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_pictures_of_another_view_do_not_count(cli, tmp_path, flown, fault):
    changes, words = FAULTS[fault]
    take(tmp_path / "DCIM", flown)
    for number in range(0, len(flown), 2):
        lat, lon, alt, yaw, _ = flown[number]
        reported = dji(AbsoluteAltitude=alt, GimbalYawDegree=yaw, GimbalPitchDegree="-90", GimbalRollDegree="0")
        write_jpeg(tmp_path / f"DCIM/DJI_{number:04d}.JPG", position=(lat, lon), alt_m=alt, xmp=reported, **changes)
    ended = cli("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--json", code=1)
    assert ended.document["counted"] == len(flown) // 2
    assert all(why.startswith(words) for why in ended.document["left_out"].values())


def test_cameras_that_look_up_or_lie_across_their_line_are_doubted(cli, tmp_path, flown):
    def doubts(pitch, turn_deg):
        with (tmp_path / "list.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["name", "lat", "lon", "alt", "yaw", "pitch"])
            writer.writerows(
                [f"{k:04d}", lat, lon, alt, yaw + turn_deg, pitch] for k, (lat, lon, alt, yaw, _) in enumerate(flown)
            )
        ended = cli(
            "judge-photos", tmp_path / "list.csv", *REQUIRED, "-o", tmp_path / "out", "--no-refly", "--force", "--json"
        )
        assert all(doubt in ended.err for doubt in ended.document["doubts"])
        return ended.document["doubts"]

    assert doubts(-90.0, 0.0) == []
    assert doubts(-90.0, 180.0) == []
    assert "degrees (median) from the flight direction" in doubts(-90.0, 90.0)[0]
    assert f"{len(flown)} of {len(flown)} photos (first: 0000" in doubts(90.0, 0.0)[0]


def test_a_verdict_that_is_there_is_not_replaced(cli, tmp_path, flown):
    take(tmp_path / "DCIM", flown[::6])
    arguments = ("judge-photos", tmp_path / "DCIM", *REQUIRED, "-o", tmp_path / "out", "--no-refly")
    cli(*arguments, code=1)
    kept = (tmp_path / "out/photos.json").read_bytes()
    assert "--force" in cli(*arguments, code=2).error
    assert (tmp_path / "out/photos.json").read_bytes() == kept
