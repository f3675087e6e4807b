"""Cameras by name or from a file: sensor, pixels, lens, and how fast they take photos."""

import math
from dataclasses import dataclass
from typing import Any

from uavcover.errors import InputError
from uavcover.new.catalog import checked_row, number_of, pair_of, read_catalog, read_row
from uavcover.new.tuning import SURVEY

_REQUIRED = ("sensor_mm", "pixels", "focal_length_mm")
_OPTIONAL = ("min_interval_s",)


@dataclass(frozen=True, slots=True)
class CameraBody:
    """A camera with its lens, in landscape: the longer side of the photo across the way it is flown.

    Attributes:
        name: in the table, or of the file.
        title: for people.
        sensor_across_mm: longer side of the sensor's part that makes the photo.
        sensor_along_mm: shorter side.
        pixels_across: pixels along the longer side.
        pixels_along: along the shorter side.
        focal_length_mm: of the lens.
        min_interval_s: shortest time between two photos; none: unknown.
        source: where the values are from.
    """

    name: str
    title: str
    sensor_across_mm: float
    sensor_along_mm: float
    pixels_across: int
    pixels_along: int
    focal_length_mm: float
    min_interval_s: float | None = None
    source: str = ""

    @property
    def fov_across_deg(self) -> float:
        """Full angle between the left and the right side of the photo."""
        return 2.0 * math.degrees(math.atan(0.5 * self.sensor_across_mm / self.focal_length_mm))

    @property
    def fov_along_deg(self) -> float:
        """Full angle between its bottom and its top."""
        return 2.0 * math.degrees(math.atan(0.5 * self.sensor_along_mm / self.focal_length_mm))

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.focal_length_mm / self.sensor_across_mm * self.pixels_across


def all_cameras() -> tuple[CameraBody, ...]:
    """The cameras of the table."""
    return tuple(
        _camera(name, row, where=f"cameras.toml: {name}") for name, row in read_catalog("cameras.toml").items()
    )


def camera_named(name: str) -> CameraBody:
    """A camera of the table, or of a TOML file of people's own.

    Raises:
        InputError: it is not known, or the file's values are not a camera's.
    """
    found, row, where = read_row(name, table="cameras.toml", option="--camera")
    return _camera(found, row, where=where)


def _camera(name: str, row: dict[str, Any], *, where: str) -> CameraBody:
    checked_row(row, where=where, required=_REQUIRED, optional=_OPTIONAL)
    width, height = pair_of(row, "sensor_mm", where=where)
    across, along = pair_of(row, "pixels", where=where)
    focal = number_of(row, "focal_length_mm", where=where)
    if focal is None or across != int(across) or along != int(along):
        raise InputError(
            f"{where}: pixels: {row['pixels']} are not whole numbers; write the number across the photo, then along it"
        )
    if abs(width / across / (height / along) - 1.0) > SURVEY.largest_pitch_difference:
        raise InputError(
            f"{where}: pixels of {1000.0 * width / across:.2f} x {1000.0 * height / along:.2f} um are not square; "
            "sensor_mm and pixels do not match (use both in landscape, for the same photo format)"
        )
    interval = number_of(row, "min_interval_s", where=where)
    camera = CameraBody(
        name, str(row["title"]), width, height, int(across), int(along), focal, interval, str(row.get("source", ""))
    )
    if not 3.0 <= camera.fov_across_deg <= 140.0:
        raise InputError(
            f"{where}: a field of view of {camera.fov_across_deg:.1f} degrees across; use the real focal length in "
            "millimetres, not the 35 mm equivalent"
        )
    return camera
