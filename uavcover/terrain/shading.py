"""The colours of a relief map. Arrays only."""

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

_LIGHT_AZIMUTH_DEG = 315.0
_LIGHT_ELEVATION_DEG = 45.0
_AMBIENT = 0.2

# Low to high, muted, so that paths and cells stand out: sage, straw, clay, stone.
_RAMP = np.array([[96, 116, 92], [150, 146, 108], [140, 116, 92], [186, 182, 178]], dtype=float)


def hillshade(gradients: FloatArray) -> FloatArray:
    """Brightness (n,) of ground with slopes (n, 2) under light from the north-west; 1 is level ground, 0 without data."""
    azimuth, elevation = math.radians(_LIGHT_AZIMUTH_DEG), math.radians(_LIGHT_ELEVATION_DEG)
    light = (
        math.sin(azimuth) * math.cos(elevation),
        math.cos(azimuth) * math.cos(elevation),
        math.sin(elevation),
    )
    facing = -gradients[:, 0] * light[0] - gradients[:, 1] * light[1] + light[2]
    facing = np.maximum(facing / np.sqrt(1.0 + (gradients**2).sum(axis=1)), 0.0) / light[2]
    return np.asarray(np.nan_to_num(_AMBIENT + (1.0 - _AMBIENT) * facing))


def shaded(rgb: tuple[int, int, int], brightness: FloatArray) -> ByteArray:
    """One colour (n, 3) uint8 under (n,) brightnesses."""
    return np.asarray(np.clip(np.outer(brightness, rgb), 0.0, 255.0), dtype=np.uint8)


def relief_colors(up_m: FloatArray, gradients: FloatArray) -> ByteArray:
    """Colours (n, 3) uint8 of ground with heights (n,) and slopes (n, 2): by height, under hillshade; black without data."""
    colors = _height_colors(up_m) * hillshade(gradients)[:, None]
    return np.asarray(np.clip(colors, 0.0, 255.0), dtype=np.uint8)


def _height_colors(up_m: FloatArray) -> FloatArray:
    known = up_m[np.isfinite(up_m)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    share = np.nan_to_num((up_m - low) / (high - low)) if high > low else np.zeros(up_m.size)
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.column_stack([np.interp(share, stops, _RAMP[:, channel]) for channel in range(3)])
