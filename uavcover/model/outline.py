"""A small map as SVG, for notebooks: lines and areas in metres, north up, with a scale bar. No dependency."""

from collections.abc import Sequence
from html import escape

import numpy as np

from uavcover.kernels.arrays import FloatArray

_WIDTH_PX = 420.0
_MARGIN_PX = 12.0
_STYLES = {
    "area": 'fill="#e8eef4" stroke="#7b8794"',
    "gap": 'fill="#d64545" stroke="none"',
    "route": 'fill="none" stroke="#2563ab" stroke-width="1.5"',
    "track": 'fill="none" stroke="#d97706" stroke-width="1.2"',
}


def svg_map(shapes: Sequence[tuple[str, FloatArray]], caption: str) -> str:
    """An inline SVG with a caption.

    Args:
        shapes: what each is ("area", "gap", "route" or "track") and its (n, 2) or (n, 3) east and north, metres.
        caption: one line.
    """
    drawn = [(kind, np.asarray(points, dtype=float)[:, :2]) for kind, points in shapes if len(points)]
    if not drawn:
        return f"<p>{escape(caption)}</p>"
    every = np.vstack([points for _, points in drawn])
    west, south = every.min(axis=0)
    extent_m = float(max(*(every.max(axis=0) - (west, south)), 1.0))
    scale = (_WIDTH_PX - 2 * _MARGIN_PX) / extent_m
    north = float(every[:, 1].max())
    height_px = (north - south) * scale + 2 * _MARGIN_PX + 20.0
    parts = []
    for kind, points in drawn:
        places = " ".join(
            f"{_MARGIN_PX + (east - west) * scale:.1f},{_MARGIN_PX + (north - n) * scale:.1f}" for east, n in points
        )
        shape = "polygon" if kind in ("area", "gap") else "polyline"
        parts.append(f'<{shape} points="{places}" {_STYLES[kind]}/>')
    bar_m = float(10.0 ** np.floor(np.log10(extent_m / 2.0)))
    foot_px = height_px - 8.0
    parts.append(
        f'<path d="M {_MARGIN_PX} {foot_px:.1f} h {bar_m * scale:.1f}" stroke="#333" stroke-width="2"/>'
        f'<text x="{_MARGIN_PX + bar_m * scale + 6:.1f}" y="{foot_px + 4:.1f}" font-size="11">{bar_m:g} m</text>'
    )
    return (
        f'<figure><svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH_PX:.0f}" height="{height_px:.0f}" role="img">'
        f"<title>{escape(caption)}</title>{''.join(parts)}</svg><figcaption>{escape(caption)}</figcaption></figure>"
    )
