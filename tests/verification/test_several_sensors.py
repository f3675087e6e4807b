"""What several sensors saw together, cell by cell."""

import numpy as np

from uavcover.verification.flown_coverage import FlownCoverage, seen_by_any

NAN = np.nan


def of(seen: list[bool], first_s: list[float], **changes: list[float]) -> FlownCoverage:
    mask = np.array(seen)
    values = {
        "surely_seen": [False] * 4, "possibly_seen": seen, "possibly_by_attitude": [False] * 4, "passes": [0] * 4,
        "nearest_m": first_s, "ground_sample_m": [NAN] * 4, "incidence_deg": [NAN] * 4, "outcome": [0] * 4, **changes,
    }  # fmt: skip
    return FlownCoverage(
        seen=mask, first_seen_s=np.array(first_s), **{name: np.array(value) for name, value in values.items()}
    )


def test_a_cell_is_as_the_sensor_saw_it_that_saw_it_best() -> None:
    one = of(
        [True, True, False, False], [5.0, 9.0, NAN, NAN], surely_seen=[True, False, False, False],
        possibly_by_attitude=[False, False, True, True], passes=[2, 1, 0, 0], ground_sample_m=[0.02, 0.03, NAN, NAN],
        incidence_deg=[10.0, 50.0, NAN, NAN], outcome=[4, 4, 1, 3],
    )  # fmt: skip
    other = of(
        [False, True, True, False], [NAN, 7.0, 8.0, NAN], surely_seen=[False, True, False, False], passes=[0, 3, 1, 0],
        ground_sample_m=[NAN, 0.05, NAN, NAN], incidence_deg=[NAN, 20.0, 30.0, NAN], outcome=[2, 4, 4, 2],
    )  # fmt: skip
    both = seen_by_any([one, other])
    assert both.seen.tolist() == [True, True, True, False]
    assert both.surely_seen.tolist() == [True, True, False, False]
    assert both.possibly_by_attitude.tolist() == [False, False, False, True]
    np.testing.assert_array_equal(both.first_seen_s, [5.0, 7.0, 8.0, NAN])
    np.testing.assert_array_equal(both.passes, [2, 4, 1, 0])
    np.testing.assert_array_equal(both.ground_sample_m, [0.02, 0.03, NAN, NAN])
    np.testing.assert_array_equal(both.incidence_deg, [10.0, 20.0, 30.0, NAN])
    np.testing.assert_array_equal(both.outcome, [4, 4, 4, 3])
    assert seen_by_any([one]).seen.tolist() == one.seen.tolist()
