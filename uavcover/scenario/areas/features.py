"""The polygons of a file before they are checked: features with names, in the file's own coordinates."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pyproj import CRS

from uavcover.errors import InputError
from uavcover.model.area import Rings

WGS84 = CRS.from_epsg(4326)
_MOST_NAMES = 12


@dataclass(frozen=True, slots=True)
class AreaFeature:
    """A feature with one or more polygons."""

    # each its outer ring and its holes, as (x, y) or (longitude, latitude) pairs in the order of the file
    polygons: tuple[Rings, ...]
    name: str = ""  # of the feature; empty without one
    layer: str = ""  # the layer, folder or kind it belongs to; empty where the format has none
    properties: Mapping[str, Any] = field(default_factory=dict)  # what else GeoJSON says of it


@dataclass(frozen=True, slots=True)
class AreaDocument:
    """The content of a file."""

    source: str  # names it in errors
    features: tuple[AreaFeature, ...]  # those with polygons, in the order of the file
    crs: CRS | None = WGS84  # their coordinate system; none when the file does not say
    others: str = ""  # what else is in it, for the error when there is no polygon: "2 lines"
    rings_may_be_open: bool = False  # whether the format leaves out the last corner, which repeats the first
    unclosed: tuple[str, ...] = ()  # places of rings that should have been closed and were not, found while reading
    notes: tuple[str, ...] = ()  # what was repaired or left out, one line each


def chosen(document: AreaDocument, layer: str | None, feature: str | None) -> tuple[tuple[str, AreaFeature], ...]:
    """The selected features, each with its name for error messages.

    Args:
        document: the file.
        layer: only this layer; none: the only one.
        feature: only features of this name, or the one of this number, counted from 1; none: all.

    Raises:
        InputError: there is none, or several layers and none was chosen; says what there is.
    """
    everything = document.features
    if not everything:
        there = f" (only {document.others})" if document.others else ""
        raise InputError(
            f"{document.source}: the file contains no polygons{there}; draw the area as a polygon and save the file again"
        )
    layers = list(dict.fromkeys(one.layer for one in everything))
    if layer is not None:
        name = _known(layer, layers, f"{document.source}: the file has no layer {layer!r}")
        everything = tuple(one for one in everything if one.layer == name)
    elif feature is None and len(layers) > 1:
        raise InputError(
            f"{document.source}: the file has polygons in several layers ({_listed(layers)}); choose one with --layer"
        )
    numbered = [(_words(number, one), one) for number, one in enumerate(everything, start=1)]
    if feature is None:
        return tuple(numbered)
    if feature.isdigit() and not any(one.name == feature for one in everything):
        if not 1 <= int(feature) <= len(numbered):
            raise InputError(
                f"{document.source}: the file has no feature {feature}; it has {len(numbered)}, counted from 1"
            )
        return (numbered[int(feature) - 1],)
    name = _known(feature, [one.name for one in everything], f"{document.source}: the file has no feature {feature!r}")
    return tuple(one for one in numbered if one[1].name == name)


def _words(number: int, feature: AreaFeature) -> str:
    return f"feature {number} ({feature.name})" if feature.name else f"feature {number}"


def _known(wanted: str, names: Sequence[str], missing: str) -> str:
    """One of the names, in any case."""
    if wanted in names:
        return wanted
    alike = {name.casefold(): name for name in names if name}
    if wanted.casefold() in alike:
        return alike[wanted.casefold()]
    if not alike:
        raise InputError(f"{missing}, and no feature has a name; omit this option")
    close = difflib.get_close_matches(wanted.casefold(), alike, n=1)
    advice = f"did you mean {alike[close[0]]!r}?" if close else f"the names are: {_listed(list(alike.values()))}"
    raise InputError(f"{missing}; {advice}")


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(name or "(no name)" for name in names[:_MOST_NAMES])
    return shown if len(names) <= _MOST_NAMES else f"{shown} and {len(names) - _MOST_NAMES} more"
