"""Ground that was measured in flight against the elevation data: bias, spread, and what becomes of the verdict."""

import dataclasses

import numpy as np
import pytest

from tests.verification.flights import Flight
from uavcover.model.scenario import Uncertainty
from uavcover.model.track import Track
from uavcover.verification.command import elevation_biases, judge_tracks, widened

pytestmark = pytest.mark.usefixtures("attitudes_count")


def with_ranges(
    flight: Flight, *, bias_m: float, noise_m: float = 0.0, key: str = "ranged", count: int | None = None
) -> Track:
    """The track with the ground below it, as high as the elevation data has it, higher, or lower."""
    assert flight.site.frame is not None
    positions = flight.track.enu_m[:count].copy()
    rng = np.random.default_rng(7)
    above = bias_m + noise_m * rng.normal(size=len(positions))
    positions[:, 2] = flight.site.ground.ups_m(positions[:, :2], above)
    return dataclasses.replace(flight.track, **{key: np.column_stack(flight.site.frame.geodetic_from_enu(positions))})


@pytest.mark.parametrize("bias_m", [-7.0, 0.0, 3.5])
@pytest.mark.parametrize("noise_m", [0.0, 0.4])
def test_bias_and_spread_are_measured(flight: Flight, bias_m: float, noise_m: float) -> None:
    (found,) = elevation_biases(flight.site, [with_ranges(flight, bias_m=bias_m, noise_m=noise_m)])
    assert found.source == "rangefinder"
    assert found.count == len(flight.track)
    assert found.bias_m == pytest.approx(bias_m, abs=0.05 + 0.1 * noise_m)
    assert found.spread_m == pytest.approx(noise_m, abs=0.01 + 0.15 * noise_m)


def test_single_wrong_readings_matter_little(flight: Flight) -> None:
    track = with_ranges(flight, bias_m=1.0, noise_m=0.1)
    ranged = track.ranged.copy()
    ranged[::9, 2] += 40.0  # birds, leaves, a bridge
    (found,) = elevation_biases(flight.site, [dataclasses.replace(track, ranged=ranged)])
    assert found.bias_m == pytest.approx(1.0, abs=0.1)
    assert found.spread_m < 0.3


def test_too_little_says_nothing(flight: Flight) -> None:
    assert elevation_biases(flight.site, [flight.track]) == ()
    assert elevation_biases(flight.site, [with_ranges(flight, bias_m=9.0, count=19)]) == ()
    far = dataclasses.replace(flight.track, ranged=np.tile([10.0, 20.0, 300.0], (50, 1)))
    assert elevation_biases(flight.site, [far]) == ()


def test_the_stated_uncertainty_is_widened_and_never_narrowed(flight: Flight) -> None:
    biases = elevation_biases(flight.site, [with_ranges(flight, bias_m=-4.0, noise_m=0.5)])
    site, words = widened(flight.site, biases)
    assert site.scenario.uncertainty.vertical_m == pytest.approx(5.0, abs=0.3)
    assert "according to the rangefinder, the ground is 4." in words[0]
    assert "m below the elevation data (median of" in words[0]
    assert "the height uncertainty is" in words[1]
    generous = dataclasses.replace(flight.site.scenario, uncertainty=Uncertainty(height_m=3.0, terrain_m=6.0))
    stated = dataclasses.replace(flight.site, scenario=generous)
    same, words = widened(stated, biases)
    assert same is stated
    assert len(words) == 1


def test_another_model_of_the_ground_is_compared_and_widens_nothing(flight: Flight) -> None:
    biases = elevation_biases(flight.site, [with_ranges(flight, bias_m=12.0, key="stored")])
    same, (words,) = widened(flight.site, biases)
    assert same is flight.site
    assert words.startswith(
        "according to the terrain data of the vehicle, the ground is 12.0 m above the elevation data"
    )


def test_a_flight_over_ground_that_is_right_passes_and_says_so(flight: Flight) -> None:
    plain = judge_tracks(flight.site, [(flight.track, flight.planned)]).report
    assert plain.verdict == "passed"
    track = with_ranges(flight, bias_m=0.0)
    report = judge_tracks(flight.site, [(track, flight.planned)]).report
    assert report.verdict == "passed"
    assert any("according to the rangefinder, the ground is 0.0 m" in finding for finding in report.findings)
    assert report.coverage_fraction == plain.coverage_fraction


def test_ground_far_higher_than_the_elevation_data_proves_no_height(flight: Flight) -> None:
    """Lower or higher than it seems, the flight may be outside of its band: nothing is proved."""
    for bias_m, limit in ((60.0, "the limit is 40 m"), (-70.0, "the limit is 120 m")):
        track = with_ranges(flight, bias_m=bias_m)
        report = judge_tracks(flight.site, [(track, flight.planned)]).report
        assert report.verdict == "not proved"
        assert not report.passed
        assert any(f"the height uncertainty is {abs(bias_m):.1f} m" in finding for finding in report.findings)
        (doubt,) = [doubt for doubt in report.doubts if "if the rangefinder is right" in doubt]
        assert limit in doubt
    stored = with_ranges(flight, bias_m=60.0, key="stored")
    assert judge_tracks(flight.site, [(stored, flight.planned)]).report.verdict == "passed"
