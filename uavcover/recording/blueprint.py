"""The viewer layout of a recording: scene, series, map and events side by side."""

import math
import uuid
from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from uavcover.model.route import Route
from uavcover.recording import layout
from uavcover.recording.layout import VIEWS
from uavcover.recording.scene import extent_m, log_scene, scene_bounds_m
from uavcover.recording.tiles import lift_m
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

_NAMESPACE = uuid.UUID("6f1c1a52-6d0b-4a55-8f3d-6b1a1c0e7d11")
_BACKGROUND_RGB = (18, 20, 26)
_EARTH_CIRCUMFERENCE_M = 40_075_016.0

LEGEND_TEXT = """
| colour | meaning |
|---|---|
| green | observed cells |
| grey | cells not observed yet |
| purple | cells not visible from any allowed position |
| white line, numbers | the planned route and its waypoints |
| yellow line | the path flown so far |
| red arrow | the vehicle and its yaw |
| pale cone | the camera's view, turned with the vehicle unless it is stabilised |
| cyan ring | ground inside the sensor's field of view |
| blue outline | the area |
| orange outline | the fence |
| violet blocks | obstacles |
| magenta outlines | no-fly zones: floor, ceiling, corners |
| red line over the heights | the maximum height above ground |
| violet line over the heights | the minimum height above ground |
"""


def make_blueprint(
    site: Site, *, span_s: tuple[float, float] | None, paths: Sequence[str] = (layout.FLOWN,)
) -> rrb.Blueprint:
    """The default blueprint of a recording.

    Args:
        site: determines the camera, and whether there is a map.
        span_s: vehicle time at the start and at the end of the flight; none for an ongoing flight, whose latest moment is
            shown.
        paths: entities of flown paths, which are drawn as far as they are flown.
    """
    words: list[rrb.ContainerLike] = [
        _events_view(),
        rrb.TextDocumentView(origin=layout.LEGEND, name="Colours"),
    ]
    below: rrb.ContainerLike = rrb.Tabs(*words, active_tab=0)
    if site.frame is not None:
        below = rrb.Horizontal(_map_view(site), below)
    whole = None
    if span_s is not None:
        start, end = (rrb.TimeRangeBoundary.absolute(seconds=at_s) for at_s in span_s)
        whole = rr.TimeRange(start=start, end=end)
    root = rrb.Horizontal(
        _scene_view(site, paths),
        rrb.Vertical(
            _series_view("height", "Height above ground", whole),
            _series_view("coverage", "Coverage, percent", whole, (0.0, 102.0)),
            rrb.Tabs(
                _series_view("speed", "Speed", whole),
                _series_view("battery", "Battery", whole),
                _series_view("link", "Link", whole),
                active_tab=0,
            ),
            below,
            row_shares=[3.0, 3.0, 2.0, 4.0],
        ),
        column_shares=[3.0, 2.0],
    )
    for number, part in enumerate(_parts(root)):
        # Random by default, so two recordings of one flight would differ.
        part.id = uuid.uuid5(_NAMESPACE, str(number))
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=layout.TIMELINE,
            playback_speed=1.0 if span_s is None else max(1.0, (span_s[1] - span_s[0]) / VIEWS.played_in_s),
            play_state="following" if span_s is None else "playing",
        ),
        auto_layout=False,
        auto_views=False,
    )


def begin_recording(
    recording: rr.RecordingStream, coverage: CoverageMap, planned: Route | None, *, name: str,
    span_s: tuple[float, float] | None, paths: Sequence[str] = (layout.FLOWN,),
) -> None:  # fmt: skip
    """Log the layout, the name, the legend and the scene of a recording; see :func:`make_blueprint`."""
    site = coverage.site
    recording.send_blueprint(make_blueprint(site, span_s=span_s, paths=paths), make_active=False, make_default=True)
    recording.send_recording_name(name)
    layout.log_static(recording, layout.LEGEND, rr.TextDocument(LEGEND_TEXT, media_type="text/markdown"))
    log_scene(recording, site, planned, lift_m=2.0 * lift_m(coverage))


def _parts(part: rrb.Container | rrb.View) -> Iterator[rrb.Container | rrb.View]:
    yield part
    if isinstance(part, rrb.Container):
        for inner in part.contents:
            yield from _parts(inner)


def _so_far() -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(
        timeline=layout.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _scene_view(site: Site, paths: Sequence[str]) -> rrb.Spatial3DView:
    west, south, east, north = bounds = scene_bounds_m(site)
    rim = np.array([[e, n] for e in np.linspace(west, east, 9) for n in np.linspace(south, north, 9)])
    up = site.ground.heights_m(rim)
    middle = np.array([(west + east) / 2.0, (south + north) / 2.0, float(np.nanmean(up))])
    reach = extent_m(bounds)
    return rrb.Spatial3DView(
        origin=layout.WORLD,
        name=site.scenario.name,
        background=_BACKGROUND_RGB,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=middle + reach * np.array([-0.42, -1.0, 0.9]),
            look_target=middle,
            eye_up=(0.0, 0.0, 1.0),
        ),
        overrides={path: _so_far() for path in paths},
    )


def _series_view(
    folder: str, name: str, whole: rr.TimeRange | None, value_range: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"{layout.SERIES}/{folder}",
        name=name,
        axis_x=None if whole is None else rrb.TimeAxis(view_range=whole),
        axis_y=None if value_range is None else rrb.ScalarAxis(range=value_range),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
    )


def _events_view() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin=layout.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[layout.TIMELINE], text_log_columns=["loglevel", "body"]),
    )


def _map_view(site: Site) -> rrb.MapView:
    lat_deg = 0.0 if site.frame is None else site.frame.lat_deg
    circle_m = _EARTH_CIRCUMFERENCE_M * math.cos(math.radians(lat_deg))
    zoom = math.log2(circle_m / VIEWS.tile_pixels * VIEWS.map_pixels / extent_m(scene_bounds_m(site)))
    return rrb.MapView(
        origin=layout.MAP,
        name="Map",
        zoom=min(zoom, 19.0),
        background=rrb.MapProvider.OpenStreetMap,
        overrides={layout.MAP_FLOWN: _so_far()},
    )
