"""Coverage of a flown track: when, how often, how closely and how surely each cell was observed, or why not."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import observation_counting as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.observation_counting import Camera, ObservationCounts, SensorPoses
from uavcover.kernels.sight import LocalSlopes, local_slopes
from uavcover.model.verdict import CellStatistics, CoverageMoment, Finding, unproved
from uavcover.run.scheduling import Workers, workers_of
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import PhotoCounts
from uavcover.sensing.sensors import add_observations
from uavcover.sensing.site_maps import judging_block, row_blocks
from uavcover.verification.flown_route import TRACK
from uavcover.verification.observations import Observations
from uavcover.verification.possible_motion import MAX_LEAN_DEG


@dataclass(frozen=True, slots=True, eq=False)
class FlownCoverage:
    """Coverage by cell; every array has one value for each cell."""

    observed: BoolArray  # whether it was observed, if measured positions and terrain are exact
    # whether it was observed for every error within the scenario's [uncertainty]; subset of ``observed``
    certain_cells: BoolArray
    # whether it may have been observed for some error, or some unknown direction of the camera; superset of ``observed``
    possible_cells: BoolArray
    possible_by_attitude: BoolArray  # whether only an observation of unknown direction may have observed it
    first_observed_s: FloatArray  # time of its first observation, NaN without one
    passes: NDArray[np.int32]  # number of separate passes that observed it
    nearest_m: FloatArray  # shortest distance of an observation, NaN without one
    # smallest ground sample distance of an observation, NaN without a known one
    ground_sample_m: FloatArray
    incidence_deg: FloatArray  # smallest incidence angle of an observation, NaN without one
    # the best outcome of any observation, see :class:`uavcover.kernels.observation_counting.ObservationCounts`
    outcome: NDArray[np.uint8]


def count_observations(coverage: CoverageMap, observations: Observations) -> FlownCoverage:
    """Count every observation of every cell of a map.

    Observations of unknown direction prove nothing; the cells that they may have observed are kept separately.
    """
    site = coverage.site
    slopes = local_slopes(site.ground.surface)
    camera = _camera(coverage, slopes)
    certain = observations.where(observations.known)
    counts = _counted(coverage, certain, slopes, camera)
    observed = counts.first >= 0
    when = np.full(observed.size, np.nan)
    when[observed] = certain.times_s[counts.first[observed]]
    exact = camera.offset_m == 0.0 and camera.turn_rad == 0.0
    possible = observed if exact else observed | (counts.possible >= camera.needed)
    doubtful = observations.where(~observations.known)
    by_attitude = possible_cells(coverage, doubtful) if len(doubtful) else np.zeros(observed.size, dtype=bool)
    return FlownCoverage(
        observed=observed,
        certain_cells=observed if exact else observed & (counts.sure >= camera.needed),
        possible_cells=possible | by_attitude,
        possible_by_attitude=by_attitude & ~observed,
        first_observed_s=when,
        passes=counts.passes,
        nearest_m=_finite(counts.nearest_m),
        ground_sample_m=_finite(counts.ground_sample_m),
        # Rounding may leave a cosine slightly above 1.
        incidence_deg=np.where(observed, np.degrees(np.arccos(np.clip(counts.cos_incidence, -1.0, 1.0))), np.nan),
        outcome=counts.outcome,
    )


def observed_by_any(each: Sequence[FlownCoverage]) -> FlownCoverage:
    """Join the observations of the same cells by several sensors.

    Args:
        each: of one sensor, at least one; times on a common clock.
    """

    def either(name: str) -> BoolArray:
        return np.asarray(np.logical_or.reduce([getattr(one, name) for one in each], axis=0))

    def least(name: str) -> FloatArray:
        return np.asarray(np.fmin.reduce([getattr(one, name) for one in each], axis=0))

    observed = either("observed")
    return FlownCoverage(
        observed=observed,
        certain_cells=either("certain_cells"),
        possible_cells=either("possible_cells"),
        possible_by_attitude=either("possible_by_attitude") & ~observed,
        first_observed_s=least("first_observed_s"),
        passes=np.asarray(np.add.reduce([one.passes for one in each], axis=0), dtype=np.int32),
        nearest_m=least("nearest_m"),
        ground_sample_m=least("ground_sample_m"),
        incidence_deg=least("incidence_deg"),
        outcome=np.asarray(np.maximum.reduce([one.outcome for one in each], axis=0), dtype=np.uint8),
    )


def possible_cells(coverage: CoverageMap, observations: Observations) -> BoolArray:
    """(cells,) whether observations of unknown direction may have seen each cell, leaning up to MAX_LEAN_DEG any way."""
    site = coverage.site
    slopes = local_slopes(site.ground.surface)
    camera = _camera(coverage, slopes)
    if site.scenario.sensor.is_camera:
        camera = camera._replace(turn_rad=max(camera.turn_rad, float(np.radians(MAX_LEAN_DEG))))
    counts = _counted(coverage, observations, slopes, camera)
    return np.asarray((counts.first >= 0) | (counts.possible > 0))


def joining_shifts_s(
    times_s: Sequence[FloatArray], *, pause_s: float, same_clock: Mapping[int, tuple[int, float]]
) -> tuple[float, ...]:
    """Seconds to add to the times of each track so that it begins ``pause_s`` after the previous ones end.

    Args:
        times_s: vehicle times of the samples of each track, increasing, in the order in which they were flown.
        pause_s: pause between two tracks.
        same_clock: for a track that records the flight of an earlier one: which one, and the seconds to add to its times to
            get those of the earlier one.

    Returns:
        one value for each track; 0 for the first.
    """
    shifts: list[float] = []
    end_s = -np.inf
    for number, times in enumerate(times_s):
        if number in same_clock:
            first, shift_s = same_clock[number]
            shifts.append(shifts[first] + shift_s)
        else:
            shifts.append(end_s + pause_s - float(times[0]) if shifts else 0.0)
        end_s = max(end_s, float(times[-1]) + shifts[-1])
    return tuple(shifts)


def joined_observations(parts: Sequence[Observations], shifts_s: Sequence[float]) -> Observations:
    """The observations of several tracks as one flight, in order of time, their times shifted by :func:`joining_shifts_s`."""
    times_s = np.concatenate([part.times_s + shift for part, shift in zip(parts, shifts_s, strict=True)])
    order = np.argsort(times_s, kind="stable")
    return Observations(
        np.vstack([part.positions_m for part in parts])[order],
        np.vstack([part.axes for part in parts])[order],
        np.vstack([part.tops for part in parts])[order],
        times_s[order],
        np.concatenate([part.known for part in parts])[order],
    )


def _counted(
    coverage: CoverageMap, observations: Observations, slopes: LocalSlopes, camera: Camera
) -> ObservationCounts:
    counts: ObservationCounts = kernels.no_observations(coverage.grid.count, camera.needed)
    poses = SensorPoses(observations.positions_m, observations.axes, observations.tops, observations.times_s)
    add_observations(coverage.site, slopes, coverage.sight, camera, coverage.grid.cells, poses, counts)
    return counts


def _camera(coverage: CoverageMap, slopes: LocalSlopes) -> Camera:
    sensor, wanted = coverage.site.scenario.sensor, coverage.site.scenario.requirements
    uncertainty = coverage.site.scenario.uncertainty
    horizontal, vertical = uncertainty.position_m, coverage.site.vertical_uncertainty_m
    # a ray shifted sideways by p at the eye and fixed at the cell meets ground that is higher by at most its slope
    # times the shift: the same as lowering the eye by p times the steepest slope.
    # Of the blocks with data: rays over the others see nothing anyway.
    steepest = float(slopes.steepest[np.isfinite(slopes.steepest)].max(initial=0.0)) if horizontal > 0.0 else 0.0
    return Camera(
        focal_px=sensor.focal_px,
        # Every waypoint is a separate observation, even soon after the previous one.
        pass_gap_s=wanted.max_gap_s if sensor.looks_along_path else -1.0,
        offset_m=float(np.hypot(horizontal, vertical)),
        horizontal_m=horizontal,
        lift_m=vertical + horizontal * steepest,
        turn_rad=float(np.radians(uncertainty.attitude_deg)) if sensor.is_camera else 0.0,
        needed=wanted.looks,
        apart_m=wanted.look_distance_m or 0.0,
    )


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


_BLOCK_CELLS = 250_000


CountObservations = Callable[[CoverageMap, Observations], FlownCoverage]
"""Counts every observation of every cell of the area."""


@contextmanager
def counter_of(scheduler: str | None) -> Iterator[CountObservations]:
    """The workers that count the observations (:func:`uavcover.run.scheduling.workers_of`); None: threads of this process."""
    if scheduler is None:
        yield count_observations
        return
    with workers_of(scheduler) as workers:
        yield count_by(workers)


def count_by(workers: Workers, *, block_cells: int = _BLOCK_CELLS) -> CountObservations:
    """Count by workers, in blocks of about ``block_cells`` cells; the result does not depend on either."""

    def count(coverage: CoverageMap, observations: Observations) -> FlownCoverage:
        # a copy of the site has nothing that can be computed again.
        flight = CountedFlight(dataclasses.replace(coverage.site), observations)
        tasks = [(rows.start, rows.stop) for rows in row_blocks(coverage.site, cells=block_cells)]
        found = dict(workers.completed(count_block, flight, tasks))
        return joined_blocks([found[task] for task in tasks])

    return count


# Coverage of a flown track by blocks of cells: each is an independent task for any worker.
#
# Whether a cell is observed does not depend on other cells, and it is the same cell in a block as among all. No
# difference arises along the edges of blocks, and a block needs no more of the flight than what was observed within
# the sensor's reach of it.


@dataclass(frozen=True, slots=True, eq=False)
class CountedFlight:
    """Data shared by the tasks of a flight."""

    site: Site  # the scenario on its ground
    observations: Observations  # of the flight, in order of time


def count_block(flight: CountedFlight, rows: tuple[int, int]) -> FlownCoverage:
    """Count every observation of the cells in some rows of the lattice: from the first number to before the second."""
    block = judging_block(flight.site, range(*rows))
    return count_observations(block, near_block(block, flight.observations))


def near_block(block: CoverageMap, observations: Observations) -> Observations:
    """Observations that may see some cell of a block under any error within the scenario's [uncertainty]."""
    centre_m = block.grid.cells.centre_m
    if len(centre_m) == 0:
        return observations.where(np.zeros(len(observations), dtype=bool))
    uncertainty = block.site.scenario.uncertainty
    halo_m = block.sight.reach_m + 2.0 * (uncertainty.position_m + block.site.vertical_uncertainty_m) + 1.0
    positions_m = observations.positions_m
    near = np.ones(len(observations), dtype=bool)
    for axis in range(2):
        near &= positions_m[:, axis] >= centre_m[:, axis].min() - halo_m
        near &= positions_m[:, axis] <= centre_m[:, axis].max() + halo_m
    return observations.where(near)


def joined_blocks(blocks: Sequence[FlownCoverage]) -> FlownCoverage:
    """The result of all blocks, in the order of their rows."""
    return FlownCoverage(
        **{each.name: np.concatenate([getattr(block, each.name) for block in blocks]) for each in fields(FlownCoverage)}
    )


# Derive findings from real photos, or from their absence, for the verdict on a flight.


@dataclass(frozen=True, slots=True)
class GivenEvidence:
    """Logs and photos of a flight that the user gave."""

    logs: tuple[Path, ...]  # flown tracks
    photos: tuple[Path, ...]  # photos, folders and lists of them
    system: int | None = None  # the vehicle of telemetry logs that have several; None: the only one


@dataclass(frozen=True, slots=True, eq=False)
class PhotoEvidence:
    """Evidence from a flight's photos, in addition to its track."""

    # coverage by cell, on the evaluation grid; None if only the track determines it
    shown: FlownCoverage | None = None
    counts: PhotoCounts | None = None  # number of photos that show each cell; None as for ``shown``
    # missing or unproved coverage, and other findings
    findings: tuple[Finding, ...] = ()
    photos_required: bool = False  # whether a flight whose vehicle reported no photo is not proved


NOTHING_KNOWN = PhotoEvidence()
_UNREPORTED = (
    "the log reports no photos: cells in view of the camera count, but nothing shows that it took photos; add the "
    "photos with --photos"
)
NO_PHOTOS = PhotoEvidence(findings=(unproved("photos", _UNREPORTED),))
"""Evidence for a flight that was not planned here: no mission of ours triggered its camera."""


def cell_statistics(coverage: CoverageMap, flown: FlownCoverage) -> CellStatistics:
    """Statistics of observations, ground sample distance and incidence over all cells."""
    observed = flown.observed

    def percentile(values: FloatArray, fraction: float) -> float | None:
        known = values[observed & np.isfinite(values)]
        return float(np.percentile(known, fraction)) if known.size else None

    return CellStatistics(
        count=coverage.grid.count,
        seen=int(observed.sum()),
        looks_mean=float(flown.passes[observed].mean()) if observed.any() else None,
        looks_max=int(flown.passes.max()),
        seen_twice_fraction=coverage.fraction(flown.passes >= 2),
        ground_sample_median_m=percentile(flown.ground_sample_m, 50.0),
        ground_sample_p95_m=percentile(flown.ground_sample_m, 95.0),
        incidence_median_deg=percentile(flown.incidence_deg, 50.0),
        incidence_p95_deg=percentile(flown.incidence_deg, 95.0),
    )


def coverage_by_time(coverage: CoverageMap, flown: FlownCoverage, times_s: FloatArray) -> tuple[CoverageMoment, ...]:
    """Coverage reached by selected moments of the (k,) observation times."""
    if times_s.size == 0:
        return ()
    order = np.flatnonzero(flown.observed)
    order = order[np.argsort(flown.first_observed_s[order], kind="stable")]
    weight = coverage.grid.weight_m2
    so_far = np.append(0.0, np.cumsum(weight[order])) / coverage.grid.area_m2
    moments = np.linspace(times_s[0], times_s[-1], TRACK.moments) if times_s[-1] > times_s[0] else times_s[:1]
    fractions = so_far[np.searchsorted(flown.first_observed_s[order], moments, side="right")]
    return tuple(CoverageMoment(float(t), float(fraction)) for t, fraction in zip(moments, fractions, strict=True))
