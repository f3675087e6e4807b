"""Whether the elevation data is right: the ground that vehicles measured in flight, against the ground they are judged on."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.judgement import noted, unproved
from uavcover.model.limits import FlightLimits
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.scenario.site import Site
from uavcover.verification.tuning import TRACK


@dataclass(frozen=True, slots=True)
class ElevationBias:
    """Difference between the ground as a vehicle knows it and the elevation data.

    Attributes:
        source: "rangefinder", which measures, or "terrain data of the vehicle", which is another model of the ground.
        count: readings over known ground.
        bias_m: median of measured less modelled height.
        spread_m: half the range of the middle 68 %.
    """

    source: str
    count: int
    bias_m: float
    spread_m: float

    @property
    def bound_m(self) -> float:
        """Largest plausible error of a height of the elevation data."""
        return abs(self.bias_m) + TRACK.spreads * self.spread_m

    def __str__(self) -> str:
        side = "above" if self.bias_m >= 0.0 else "below"
        return (
            f"according to the {self.source}, the ground is {abs(self.bias_m):.1f} m {side} the elevation data "
            f"(median of {self.count}, spread {self.spread_m:.1f} m)"
        )


def elevation_biases(site: Site, tracks: Sequence[Track]) -> tuple[ElevationBias, ...]:
    """Compare the ground that tracks report with that of a site; nothing where too little is reported.

    With a surface model a rangefinder is compared with whichever of ground and surface is nearer to its reading: through
    leaves it hits either.
    """
    found = []
    for source, readings in (
        ("rangefinder", [track.ranged for track in tracks]),
        ("terrain data of the vehicle", [track.stored for track in tracks]),
    ):
        differences = _differences_m(
            site, np.concatenate([np.empty((0, 3)), *readings]), with_surface=source == "rangefinder"
        )
        if len(differences) < TRACK.fewest_samples:
            continue
        low, middle, high = np.percentile(differences, (16.0, 50.0, 84.0))
        found.append(ElevationBias(source, len(differences), float(middle), float(0.5 * (high - low))))
    return tuple(found)


def widened(site: Site, biases: Sequence[ElevationBias]) -> tuple[Site, tuple[str, ...]]:
    """The site with the height uncertainty that measurements show, where the stated one is smaller; and the notes on it.

    The vehicle's own terrain data is no measurement, and widens nothing.
    """
    words = [str(bias) for bias in biases]
    stated = site.scenario.uncertainty
    shown_m = max((bias.bound_m for bias in biases if bias.source == "rangefinder"), default=0.0)
    if shown_m <= stated.vertical_m:
        return site, tuple(words)
    words.append(
        f"the height uncertainty is {shown_m:.1f} m according to the rangefinder, instead of the stated "
        f"{stated.vertical_m:.1f} m"
    )
    uncertainty = dataclasses.replace(stated, terrain_m=shown_m - stated.height_m)
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, uncertainty=uncertainty)), tuple(words)


def with_measured_ground(
    report: VerificationReport, limits: FlightLimits, biases: Sequence[ElevationBias], found: Sequence[str]
) -> VerificationReport:
    """The report with what was found; a height that the measured ground moves beyond its limit is not proved."""
    findings = list(map(noted, found))
    for bias in biases:
        low, high = report.min_height_agl_m, report.max_height_agl_m
        if bias.source != "rangefinder" or low is None or high is None:
            continue
        for seems_m, limit_m, beyond in (
            (low, limits.min_height_agl_m, low - bias.bias_m < limits.min_height_agl_m <= low),
            (high, limits.max_height_agl_m, high - bias.bias_m > limits.max_height_agl_m >= high),
        ):
            if beyond:
                text = (
                    f"a height above ground of {seems_m:.1f} m was {seems_m - bias.bias_m:.1f} m if the rangefinder "
                    f"is right and the elevation data are wrong; the limit is {limit_m:g} m"
                )
                findings.append(unproved("height-band", text))
    return report.with_findings(findings)


def _differences_m(site: Site, readings: FloatArray, *, with_surface: bool) -> FloatArray:
    if site.frame is None or not len(readings):
        return np.empty(0)
    places = site.frame.enu_from_geodetic(*readings.T)
    above = site.bare_ground.heights_agl_m(places)
    if with_surface and site.ground_model is not None:
        over = site.ground.heights_agl_m(places)
        above = np.where(np.abs(over) < np.abs(above), over, above)
    return np.asarray(above[np.isfinite(above)])
