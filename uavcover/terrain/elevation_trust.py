"""Asking whether heights that do not look like ground are taken as they are."""

from typing import Protocol

import numpy as np
import shapely

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.suspect_heights import suspect_places
from uavcover.terrain.terrain_source import TerrainSource
from uavcover.terrain.tuning import FILES


class Asked(Protocol):
    """Receiver of warnings and questions, as :class:`uavcover.run.user.User`."""

    def warn(self, line: str) -> None:
        """Show a warning."""

    def agrees(self, question: str) -> bool:
        """Ask a question that is answered by yes or no."""


def trust_asked_for(
    source: TerrainSource,  # the elevation data of the ground
    datum: str,  # of its heights
    region: shapely.Polygon | shapely.MultiPolygon,  # where flights may go, (east, north) metres
    frame: LocalFrame,  # of the region
    user: Asked,  # is asked
    *,
    trusted: bool,  # whether the answer was given: then nothing is looked at
) -> bool:
    """Whether heights that do not look like ground are taken as they are; asks where there are any.

    Raises:
        InputError: there are such heights, and the user does not want them, or was not there to be asked.
    """
    if trusted:
        return True
    on_earth = shapely.transform(region, lambda p: _lon_lat_deg(p, frame))
    found = suspect_places(source, datum, on_earth.bounds, on_earth)
    if not found:
        return False
    for one in found[: FILES.most_suspects]:
        user.warn(f"{source.name} has {one.words}")
    if user.agrees("check that the terrain has this shape"):
        return True
    more = f" and {len(found) - 1} more of this kind" if len(found) > 1 else ""
    raise InputError(
        f"{source}: the data contains {found[0].words}{more}; use other data, or mark the missing heights "
        "(gdal_edit.py -a_nodata); if the heights are correct, use --trust-dem (terrain.trust_heights = true)"
    )


def _lon_lat_deg(east_north_m: FloatArray, frame: LocalFrame) -> FloatArray:
    lat, lon, _ = frame.geodetic_from_enu(np.column_stack([east_north_m, np.zeros(len(east_north_m))]))
    return np.column_stack([frame.lon_deg + np.mod(lon - frame.lon_deg + 180.0, 360.0) - 180.0, lat])
