"""Vehicles with sensors of their own: the planner divides the area, each is planned, flown and judged by its own sensor."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.extras.fleet.lockstep import Hangar
from tests.extras.fleet.test_fleet import Listener
from tests.extras.fleet.test_fly_fleet import copied, fly, judged, lost_at, no_recording_of_single_flights
from tests.extras.fleet.test_unlike_fleet import FAR, unlike_site
from tests.planner.test_fleet_parts import request
from uavcover.errors import InfeasibleError
from uavcover.extras.fleet.command import FleetFailedError
from uavcover.extras.fleet.jobs import planned_jobs, time_for
from uavcover.model.sensor import FrameCamera, NadirCamera
from uavcover.planner.command import plan_into
from uavcover.planner.fleet_parts import first_paces, part_sites
from uavcover.run.documents import read_planned, site_for
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import dump_scenario, load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import groups_of, vehicle_sites
from uavcover.sensing.site_maps import fleet_map, judging_map, map_for

assert no_recording_of_single_flights  # a fixture that every flight here uses
NARROW = NadirCamera(kind="nadir-camera", fov_deg=40.0, range_m=200.0, max_incidence_deg=75.0)
PHOTOS = FrameCamera(
    kind="frame-camera", fov_across_deg=60.0, fov_along_deg=45.0, range_m=200.0, pixels_across=4000, forward_overlap=0.3
)


def site_of_sensors(folder: Path, *own: NadirCamera | FrameCamera | None) -> Site:
    """The corner of the demo, vehicles in turn at the demo's home and at the other corner."""
    site = unlike_site(folder, [None if k % 2 == 0 else FAR for k in range(len(own))])
    vehicles = tuple(
        dataclasses.replace(vehicle, sensor=sensor) for vehicle, sensor in zip(site.scenario.vehicles, own, strict=True)
    )
    planner = dataclasses.replace(site.scenario.planner, evaluations=20, population_size=20)
    return load_site(dataclasses.replace(site.scenario, vehicles=vehicles, planner=planner))


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Vehicle 1 takes pictures, vehicle 2 has the camera of the scenario."""
    folder = tmp_path_factory.mktemp("sensors")
    site = site_of_sensors(folder, PHOTOS, None)
    outcome = plan_into(request(folder / "run", site), Listener(), check_site=lambda _: None)
    assert outcome.exit_code == 0
    return RunFolder(folder / "run")


def test_vehicles_with_equal_sensors_share_a_part(tmp_path: Path) -> None:
    site = site_of_sensors(tmp_path, None, NARROW, NARROW, None)
    assert groups_of(site.scenario) == ((1, 4), (2, 3))
    assert groups_of(site_of_sensors(tmp_path, NARROW, NARROW).scenario) == ()
    assert {own.scenario.sensor for own in vehicle_sites(site_of_sensors(tmp_path, NARROW, NARROW))} == {NARROW}


def test_the_area_is_divided_by_how_fast_each_sees_it(tmp_path: Path) -> None:
    site = site_of_sensors(tmp_path, None, NARROW)
    wide, narrow = first_paces(site)
    # Twice the half angle at the same height: tan 35 degrees over tan 20 degrees.
    assert wide / narrow == pytest.approx(np.tan(np.radians(35.0)) / np.tan(np.radians(20.0)), rel=0.05)
    for paces in (None, [3.0, 1.0]):
        first, second = part_sites(site, paces)
        assert first.area.area + second.area.area == pytest.approx(site.area.area)
        assert shapely.union(first.area, second.area).symmetric_difference(site.area).area < 1e-3
        assert first.area.area / second.area.area == pytest.approx(3.0 if paces else wide / narrow, rel=0.02)
        for own, other in ((first, second), (second, first)):
            assert own.home_m is not None
            home = shapely.Point(own.home_m[:2])
            assert own.area.centroid.distance(home) < other.area.centroid.distance(home)


def test_what_any_sensor_can_see_is_coverable(tmp_path: Path) -> None:
    site = site_of_sensors(tmp_path, dataclasses.replace(NARROW, max_incidence_deg=10.0, range_m=42.0), NARROW)
    poor, good = (map_for(site, own) for own in vehicle_sites(site))
    whole = fleet_map(site)
    assert np.array_equal(whole.grid.cells.centre_m, poor.grid.cells.centre_m)
    assert np.array_equal(whole.coverable, poor.coverable | good.coverable)
    assert poor.coverable.sum() < good.coverable.sum()
    alike = site_of_sensors(tmp_path, None, None)
    assert fleet_map(alike) is judging_map(alike)


def test_each_part_is_planned_for_its_sensor(planned: RunFolder) -> None:
    site = load_site(load_scenario(planned.file("scenario.toml")))
    assert load_scenario(planned.file("scenario.toml")) == site.scenario
    assert "forward_overlap" in dump_scenario(site.scenario)
    jobs = {job.vehicle: job for job in planned_jobs(planned, 2)}
    assert jobs[1].site.scenario.sensor == PHOTOS
    assert jobs[2].site.scenario.sensor == site.scenario.sensor
    trigger = "\t206\t"  # DO_SET_CAM_TRIGG_DIST
    assert trigger not in jobs[2].folder.file("mission.waypoints").read_text()
    assert trigger in jobs[1].folder.file("mission.waypoints").read_text()
    observed = np.logical_or.reduce(
        [judging_map(job.site).observed(job.route.waypoints_m) for job in jobs.values()], axis=0
    )
    metrics = planned.read_json("plan.json", made_by="test")["metrics"]
    assert metrics["coverage_fraction"] == judging_map(site).fraction(observed)
    with pytest.raises(InfeasibleError, match="it requires a sensor that the remaining vehicles do not have"):
        time_for(jobs[2], jobs[2].route, jobs[1].site)


def test_it_is_flown_and_judged_by_each_ones_sensor(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    # Vehicle 1 falls from the sky: no other vehicle has its camera, so what it leaves is a gap.
    with pytest.raises(FleetFailedError) as failed:
        fly(run, Hangar(2, lost_at(5, number=1)), user)
    assert any("remains unflown, as a gap: it requires a sensor" in line for line in user.lines)
    reported = failed.value.details()
    document = judged(run)
    whole = next(job for job in planned_jobs(planned, 2) if job.vehicle == 2)
    own = judging_map(whole.site)
    least = own.fraction(own.observed(whole.route.waypoints_m))
    assert least - 0.02 < document["coverage_fraction"] < document["planned_coverage_fraction"]
    gaps_track = run.path / "gaps" / "track.csv"
    # The gap mission is vehicle 1's, with its camera.
    gaps, mission = read_planned(RunFolder(run.path / "gaps"))
    assert reported["gaps"]["gaps"] > 0
    assert gaps.scenario.sensor == PHOTOS
    eyes = judging_map(gaps)
    assert eyes.fraction(eyes.observed(mission.route.waypoints_m)) > 0.5 * (1.0 - document["coverage_fraction"])
    # Flown from there, it is judged by that camera together with the others.
    assert site_for(gaps_track, run, load_site(load_scenario(run.file("scenario.toml")))).scenario.sensor == PHOTOS
