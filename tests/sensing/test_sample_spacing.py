"""A sensor that looks along the path sees its whole swath, whatever its size: in plans, in verdicts and in reports."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely

from uavcover.errors import ScenarioError
from uavcover.scenario.scenario_file import bundled_scenarios, load_scenario, parse_scenario
from uavcover.scenario.site import build_site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.sensors import LONGEST_SPACING_M, sample_spacing_m
from uavcover.verification.observations import level_observations

HEIGHT_M = 20.0
SCENARIO = """
name = "flat"
[area]
polygon_east_north_m = [[0, 0], [{side}, 0], [{side}, {side}], [0, {side}]]
cell_size_m = {cell}
[terrain]
kind = "sine-cosine"
scale_m = 1e-3
[sensor]
{sensor}
sensing = "along-path"
[limits]
min_height_agl_m = 20.0
max_height_agl_m = 30.0
"""
SENSORS = {
    "disc of 1.5 m": 'kind = "disc"\nradius_m = 1.5',
    "disc of 0.2 m": 'kind = "disc"\nradius_m = 0.2',
    "disc of 80 m": 'kind = "disc"\nradius_m = 80.0',
    "narrow camera": 'kind = "nadir-camera"\nfov_deg = 8.0\nrange_m = 60.0',
    "wide camera": 'kind = "nadir-camera"\nfov_deg = 90.0\nrange_m = 200.0',
    "short sphere": 'kind = "sphere"\nrange_m = 25.3',
    "narrow picture": 'kind = "frame-camera"\nfov_across_deg = 40.0\nfov_along_deg = 4.0\nrange_m = 90.0',
    "tilted picture": 'kind = "frame-camera"\nfov_across_deg = 20.0\nfov_along_deg = 10.0\nrange_m = 90.0\npitch_deg = -60.0',
}


def site_of(sensor: str, *, side_m: float = 10.0, cell_m: float = 0.2):
    text = SCENARIO.format(sensor=sensor, side=side_m, cell=cell_m)
    return build_site(parse_scenario(text, source="s", folder=Path()))


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS.keys())
def test_a_swath_counts_in_full(sensor):
    reach_m = site_of(sensor).scenario.sensor.half_width_m(HEIGHT_M)
    side_m = 12.0 * reach_m
    site = site_of(sensor, side_m=side_m, cell_m=reach_m / 12.0)
    # Long legs: a planned one has no places in between, and a track may have a sample every ten metres and more.
    lines = np.arange(reach_m, side_m, 2.0 * reach_m)
    ends = np.array([(-2.0 * side_m, 3.0 * side_m)[:: 1 - 2 * (k % 2)] for k in range(len(lines))]).ravel()
    route = np.column_stack([ends, np.repeat(lines, 2), np.full(len(ends), HEIGHT_M)])
    coverage = CoverageMap(site, cell_size_m=reach_m / 12.0)
    weight = coverage.grid.weight_m2

    def fraction(observed):
        return float(weight[observed].sum() / weight.sum())

    fine = dataclasses.replace(
        site.scenario, sensor=dataclasses.replace(site.scenario.sensor, sample_spacing_m=reach_m / 30.0)
    )
    ideal = fraction(CoverageMap(build_site(fine), cell_size_m=reach_m / 12.0).observed(route))
    assert ideal > 0.93
    assert fraction(coverage.observed(route)) > ideal - 0.02
    flown = level_observations(site, route, 0.0)
    headings = np.zeros((len(flown.positions_m), 2))
    headings[:, 0] = 1.0
    assert fraction(coverage.observed_by(LevelObservations(flown.positions_m, headings))) > ideal - 0.05


@pytest.mark.parametrize("turned_deg", [20.0, 45.0, 70.0])
def test_an_oblique_swath_of_a_fixed_heading_counts_in_full(turned_deg):
    sensor = 'kind = "frame-camera"\nfov_across_deg = 60.0\nfov_along_deg = 50.0\nrange_m = 90.0\n'
    sensor += 'mount = "stabilised"\nheading_deg = 0.0'
    site = site_of(sensor, side_m=60.0, cell_m=0.5)
    along = np.array([np.sin(np.radians(turned_deg)), np.cos(np.radians(turned_deg))])
    route = np.array([[*(30.0 + t * along), HEIGHT_M] for t in (-80.0, 80.0)])
    fine = dataclasses.replace(site.scenario, sensor=dataclasses.replace(site.scenario.sensor, sample_spacing_m=0.1))
    observed, ideal = (CoverageMap(of, cell_size_m=0.5).observed(route).mean() for of in (site, build_site(fine)))
    assert 0.3 < ideal < 0.7
    assert 0.98 * ideal < observed <= ideal


def test_a_stated_spacing_that_leaves_gaps_is_refused():
    site = site_of(SENSORS["disc of 1.5 m"] + "\nsample_spacing_m = 10.0")
    with pytest.raises(
        ScenarioError,
        match=r"leaves gaps, because the sensor observes only 1\.5 m to each side; remove this key, or use",
    ):
        sample_spacing_m(site.scenario)
    with pytest.raises(ScenarioError, match="sample_spacing_m: 10 m"):
        CoverageMap(site, cell_size_m=1.0).observed(np.array([[0.0, 5.0, 20.0], [10.0, 5.0, 20.0]]))
    assert sample_spacing_m(site_of(SENSORS["disc of 1.5 m"] + "\nsample_spacing_m = 1.5").scenario) == 1.5


def test_wide_footprints_and_bundled_scenarios_are_sampled_as_before():
    for name in ("disc of 80 m",):
        assert sample_spacing_m(site_of(SENSORS[name]).scenario) == LONGEST_SPACING_M
    for name in bundled_scenarios():
        scenario = load_scenario(name)
        if scenario.sensor.looks_along_path:
            assert sample_spacing_m(scenario) == 10.0


def test_pictures_by_distance_need_no_spacing():
    photo = (
        'kind = "frame-camera"\nfov_across_deg = 40.0\nfov_along_deg = 4.0\nrange_m = 90.0\ntrigger_distance_m = 1.0'
    )
    site = site_of(photo + "\nsample_spacing_m = 10.0")
    assert sample_spacing_m(site.scenario) == 10.0
    assert shapely.area(site.area) > 0.0


def test_a_band_without_a_floor_is_not_sampled_every_few_millimetres() -> None:
    """``verify`` of a flight without a plan knows no lowest height and took 1.3 million observations of 200 m of ground."""
    scenario = site_of(SENSORS["wide camera"]).scenario
    limits = dataclasses.replace(scenario.limits, min_height_agl_m=0.01, height_margin_m=0.0)
    assert sample_spacing_m(dataclasses.replace(scenario, limits=limits)) > 1.0
