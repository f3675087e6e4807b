"""Coverage of an area by photos, and its files."""

import csv
import io
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.errors import InputError
from uavcover.extras.photos.photo import Photo
from uavcover.extras.photos.placing import LocatedPhotos
from uavcover.extras.photos.showing import ShownCells
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.sensor import FrameCamera, Sensor
from uavcover.model.verdict import Judgement
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import frame_camera
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground
from uavcover.verification.command import LAYER_REASONS
from uavcover.verification.flown_coverage import FlownCoverage
from uavcover.verification.gaps import GapRegion, cells_geotiff, reason_codes


@dataclass(frozen=True, slots=True, eq=False)
class PhotoVerdict:
    """Verdict on photos."""

    site: Site  # the site of the area, for planning a flight
    coverage: CoverageMap  # its cells with the whole photo in view
    placed: LocatedPhotos  # the photos that count
    shown: ShownCells  # the ground that they show
    drawn: BoolArray  # (cells,) of the area without its margin
    required: int | None  # photos in which the overlap asked for puts each point; None if none is
    blur_px: FloatArray  # (n,) of each photo that counts, NaN if unknown
    gaps: list[GapRegion]  # areas with too few photos
    judgement: Judgement  # the decision, and its reasons
    document: dict[str, Any]  # the content of ``photos.json``
    too_blurred: int = 0  # photos that do not count because their blur exceeds the limit

    @property
    def needed(self) -> int:
        """Required number of photos of each cell."""
        return self.required or 1

    @property
    def coverage_as_required(self) -> FlownCoverage:
        """The coverage in which a cell counts as observed when it is in the required number of photos, and the margin."""
        return replace(self.shown.coverage, observed=self.shown.enough(self.needed) | ~self.drawn)

    @property
    def lacking(self) -> BoolArray:
        """(cells,) of the drawn area that are visible but in too few photos."""
        return self.drawn & self.coverage.coverable & ~self.shown.enough(self.needed)


def frame_of(site: Site) -> LocalFrame:
    """The local frame of a site on Earth. Raises InputError: it has no position on Earth."""
    if site.frame is None:
        raise InputError(f"scenario {site.scenario.name} has no position on Earth, so photos cannot be located in it")
    return site.frame


def blur_px(placed: LocatedPhotos, sensor: Sensor, heights_m: FloatArray) -> FloatArray:
    """(n,) pixels by which the ground below moves while the shutter is open; NaN if unknown."""
    focal = sensor.focal_px
    speeds = _speeds_m_s(placed)
    exposures = np.array([np.nan if p.exposure_s is None else p.exposure_s for p in placed.photos])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(heights_m > 0.0, speeds * exposures * focal / heights_m, np.nan)


def _speeds_m_s(placed: LocatedPhotos) -> FloatArray:
    reported = np.array([np.nan if p.speed_m_s is None else p.speed_m_s for p in placed.photos])
    times = np.array([np.nan if p.time_s is None else p.time_s for p in placed.photos])
    if len(reported) < 2:
        return reported
    step_s, step_m = np.diff(times), np.linalg.norm(np.diff(placed.eyes_m, axis=0), axis=1)
    clocks = [p.clock for p in placed.photos]
    same = np.array([one == other for one, other in itertools.pairwise(clocks)])
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(same & (step_s > 0.0) & (step_s <= 10.0), step_m / step_s, np.nan)
    onwards, before = np.append(speed, np.nan), np.append(np.nan, speed)
    return np.where(np.isfinite(reported), reported, np.where(np.isfinite(onwards), onwards, before))


def clocks_of(photos: Sequence[Photo]) -> list[dict[str, Any]]:
    """Each clock of some photos: their number, first and last time, and the offset to UTC where it is known.

    A camera's clock without a zone shows local time, or what somebody set: its times are written without one.
    """
    clocks = []
    for clock in sorted({p.clock for p in photos if p.clock is not None}):
        times = [p.time_s for p in photos if p.clock == clock and p.time_s is not None]
        ahead = [
            p.utc_s - p.time_s for p in photos if p.clock == clock and p.utc_s is not None and p.time_s is not None
        ]
        clocks.append(
            {
                "clock": clock,
                "pictures": len(times),
                "first_s": min(times),
                "last_s": max(times),
                "utc_minus_clock_s": float(np.median(ahead)) if ahead else None,
            }
        )
    return clocks


def photo_table(verdict: PhotoVerdict, site: Site) -> str:
    """A row for each photo that counts, then those that do not."""
    heights_m = site.ground.heights_agl_m(verdict.placed.eyes_m)
    blur = verdict.blur_px
    lat, lon, alt = frame_of(site).geodetic_from_enu(verdict.placed.eyes_m)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["name", "counted", "reason", "lat_deg", "lon_deg", "alt_amsl_m", "height_agl_m", "direction_known", "blur_px"]
    )
    for k, photo in enumerate(verdict.placed.photos):
        row = [f"{lat[k]:.7f}", f"{lon[k]:.7f}", f"{alt[k]:.2f}", f"{heights_m[k]:.1f}"]
        known = "yes" if verdict.placed.direction_known[k] else "no"
        writer.writerow([photo.name, "yes", "", *row, known, f"{blur[k]:.2f}" if math.isfinite(blur[k]) else ""])
    for name, why in verdict.placed.left_out.items():
        writer.writerow([name, "no", why, "", "", "", "", "", ""])
    return text.getvalue()


def footprints_m(verdict: PhotoVerdict, *, every: int = 1) -> Iterator[tuple[int, FloatArray]]:
    """Number of each photo that counts, or of one in ``every``, and (k, 3) ENU, its footprint's edge on the ground."""
    sensor = frame_camera(verdict.coverage.site.scenario.sensor, source=verdict.site.scenario.name)
    for number in range(0, len(verdict.placed.photos), every):
        edge = footprint_m(verdict.placed, number, sensor, verdict.site.ground, reach_m=sensor.range_m)
        if len(edge) >= 3:
            yield number, edge


def footprint_polygons(verdict: PhotoVerdict) -> Iterator[tuple[int, shapely.Polygon]]:
    """The number of each photo that counts, and its footprint in longitude and latitude."""
    frame = frame_of(verdict.site)
    for number, edge in footprints_m(verdict):
        lat, lon, _ = frame.geodetic_from_enu(np.vstack([edge, edge[:1]]))
        yield number, shapely.orient_polygons(shapely.Polygon(np.column_stack([lon, lat]).round(8)))


def footprints_geojson(verdict: PhotoVerdict) -> dict[str, Any]:
    """A polygon on the ground for each photo that counts (RFC 7946)."""
    features = []
    for number, shape in footprint_polygons(verdict):
        properties = {"name": verdict.placed.photos[number].name}
        features.append({"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": properties})
    return {"type": "FeatureCollection", "features": features}


def photo_raster(verdict: PhotoVerdict) -> bytes:
    """Photos of each cell as a GeoTIFF."""
    coverage, shown = verdict.coverage, verdict.shown
    flown = shown.coverage
    enough = replace(flown, observed=shown.enough(verdict.needed))
    sureness = flown.observed.astype(float) + flown.possible_cells + flown.certain_cells
    layers: list[tuple[str, str, NDArray[Any]]] = [
        ("pictures", "photos that show the cell", shown.photos),
        ("directions", "number of directions (out of nine: down, and eight compass directions)", shown.directions),
        ("ground_sample_m", "smallest ground sample distance in metres", flown.ground_sample_m),
        ("incidence_deg", "smallest incidence angle in degrees", flown.incidence_deg),
        (
            "sureness",
            "0: not observed, 1: possibly observed, 2: observed if measurements are exact, 3: certainly observed",
            sureness,
        ),
        ("reason", LAYER_REASONS, reason_codes(coverage, enough)),
    ]
    if shown.detection is not None:
        words = f"probability of detection, 0 to 1: {shown.detection.curve.title}"
        layers.append(("pod", words, shown.detection.pod))
    return cells_geotiff(coverage, frame_of(verdict.site), layers)


_A_SIDE = 4


def footprint_m(
    placed: LocatedPhotos, number: int, sensor: FrameCamera, ground: Ground, *, reach_m: float
) -> FloatArray:
    """(k, 3) ENU, the places where the edge of a photo first meets the ground, in order around it.

    Rays that meet no ground within ``reach_m`` are omitted; fewer than three places are no footprint.
    """
    eye, axis, top = placed.eyes_m[number], placed.axes[number], placed.tops[number]
    right = np.cross(axis, top)
    across = np.tan(np.radians(0.5 * sensor.fov_across_deg))
    along = np.tan(np.radians(0.5 * sensor.fov_along_deg))
    fraction = np.linspace(-1.0, 1.0, _A_SIDE + 1)[:-1]
    one = np.ones(_A_SIDE)
    x = np.concatenate([fraction, one, -fraction, -one]) * across
    y = np.concatenate([-one, fraction, one, -fraction]) * along
    rays = axis + x[:, None] * right + y[:, None] * top
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    distances = np.linspace(0.0, reach_m, 401)
    line = eye + distances[None, :, None] * rays[:, None, :]
    above = ground.heights_agl_m(line.reshape(-1, 3)).reshape(line.shape[:2])
    below = above < 0.0  # ground that is not known (NaN) stops no ray
    met = below.any(axis=1)
    first = np.argmax(below, axis=1)[met]
    low, high = distances[np.maximum(first - 1, 0)], distances[first]
    for _ in range(20):
        middle = 0.5 * (low + high)
        under = ground.heights_agl_m(eye + middle[:, None] * rays[met]) < 0.0
        low, high = np.where(under, low, middle), np.where(under, middle, high)
    positions: FloatArray = eye + high[:, None] * rays[met]
    return positions
