"""Take-off and landing position of a vehicle."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.value_checks import STRICT, require


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """Take-off and landing position on the ground. Use one of the two pairs of keys.

    Attributes:
        lat_deg: latitude on WGS 84.
        lon_deg: longitude on WGS 84.
        east_m: east in the local frame, for areas given in metres.
        north_m: north in the local frame.
    """

    __pydantic_config__: ClassVar = STRICT

    lat_deg: float | None = None
    lon_deg: float | None = None
    east_m: float | None = None
    north_m: float | None = None

    def __post_init__(self) -> None:
        geographic = self.lat_deg is not None and self.lon_deg is not None
        local = self.east_m is not None and self.north_m is not None
        any_geographic = self.lat_deg is not None or self.lon_deg is not None
        any_local = self.east_m is not None or self.north_m is not None
        require(
            (geographic and not any_local) or (local and not any_geographic),
            "specify lat_deg and lon_deg, or east_m and north_m",
        )
        require(self.lat_deg is None or abs(self.lat_deg) <= 90.0, f"lat_deg: {self.lat_deg} is outside -90..90")
        require(self.lon_deg is None or abs(self.lon_deg) <= 180.0, f"lon_deg: {self.lon_deg} is outside -180..180")
