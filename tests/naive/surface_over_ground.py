"""The higher of two elevation files, and what lies under the one and on the other, from rasterio and pyproj alone."""

import numpy as np

from tests.naive.file_ground import FileGround


class HigherFile:
    """The higher of the bilinear surfaces of two files; unknown where the surface file is."""

    def __init__(self, ground, surface):
        self.ground, self.surface = FileGround(ground), FileGround(surface)

    def height_m(self, lat_deg, lon_deg):
        """Height above sea level at places of any shape."""
        low, high = self.ground.height_m(lat_deg, lon_deg), self.surface.height_m(lat_deg, lon_deg)
        return np.where(np.isnan(low), high, np.maximum(low, high))

    def is_hidden(self, lat_deg, lon_deg, *, by_m):
        """Whether the surface lies more than this above the ground."""
        return self.height_m(lat_deg, lon_deg) - self.ground.height_m(lat_deg, lon_deg) > by_m
