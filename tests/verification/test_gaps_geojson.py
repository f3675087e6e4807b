"""The regions that were not seen as shapes on a map: where they are, how large, and why."""

import dataclasses

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat
from tests.verification.flights import fly_along, make_site
from tests.verification.test_cells import LINE, verdict_on
from uavcover.errors import InputError
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.gaps import GapRegion, gaps_geojson
from uavcover.verification.verify import FlownTrack, Verdict, verify_flight


def local_shapes(verdict: Verdict, regions: list[GapRegion]) -> list[shapely.MultiPolygon]:
    """What the document says, back in metres of the local frame."""
    frame = verdict.coverage.site.frame
    assert frame is not None

    def to_metres(lon_lat: np.ndarray) -> np.ndarray:
        # On flat ground every corner lies at the height of the origin.
        enu = frame.enu_from_geodetic(lon_lat[:, 1], lon_lat[:, 0], np.full(len(lon_lat), 400.0))
        return np.asarray(enu[:, :2])

    document = gaps_geojson(verdict.coverage, regions)
    return [shapely.transform(shapely.geometry.shape(f["geometry"]), to_metres) for f in document["features"]]


def test_each_region_is_a_shape_with_its_reason_and_size() -> None:
    verdict = verdict_on(make_site(flat), LINE)
    regions = list(verdict.gaps)
    document = gaps_geojson(verdict.coverage, regions)
    assert document["type"] == "FeatureCollection"
    assert [feature["id"] for feature in document["features"]] == list(range(len(regions)))
    for feature, region in zip(document["features"], regions, strict=True):
        gap = region.gap
        assert (feature["type"], feature["geometry"]["type"]) == ("Feature", "MultiPolygon")
        assert feature["properties"] == {
            "reason": gap.reason, "coverable": gap.coverable, "cells": gap.cells, "area_m2": gap.area_m2,
        }  # fmt: skip


def test_the_shapes_are_the_squares_of_exactly_their_cells() -> None:
    verdict = verdict_on(make_site(flat), LINE)
    middles = verdict.coverage.grid.cells.centre_m
    # A ring of cells around one that was seen, two cells that touch at a corner, and a single one.
    vertical, row = np.floor(middles[:, 0] / 10.0), np.floor(middles[:, 1] / 10.0)
    ring = (np.abs(vertical - 3) <= 1) & (np.abs(row - 3) <= 1) & ~((vertical == 3) & (row == 3))
    corner = ((vertical == 10) & (row == 5)) | ((vertical == 11) & (row == 6))
    single = (vertical == 20) & (row == 10)
    cells = [np.flatnonzero(chosen) for chosen in (ring, corner, single)]
    regions = [dataclasses.replace(verdict.gaps[0], cells=numbers) for numbers in cells]
    shapes = local_shapes(verdict, regions)
    for shape, numbers in zip(shapes, cells, strict=True):
        squares = shapely.union_all(shapely.box(*(middles[numbers, :2] - 5.0).T, *(middles[numbers, :2] + 5.0).T))
        assert shape.symmetric_difference(squares).area < 0.01 * squares.area
        assert all(part.exterior.is_ccw for part in shape.geoms)
    assert [len(shape.geoms) for shape in shapes] == [1, 2, 1]
    assert len(shapes[0].geoms[0].interiors) == 1


def test_corners_outside_of_the_elevation_data_have_a_place() -> None:
    # Cells of 16 m: the last ones reach from 288 to 304 m, and the data to 300 m.
    site = make_site(lambda east, north: np.where(east > 300.0, np.nan, 0.0 * north), home=None)
    verdict = verify_flight(site, CoverageMap(site, cell_size_m=16.0), [FlownTrack(fly_along(site, LINE))])
    corners = np.concatenate([shapely.get_coordinates(shape) for shape in local_shapes(verdict, list(verdict.gaps))])
    assert np.isfinite(corners).all()
    assert corners[:, 0].max() > 300.0


def test_without_a_place_on_earth_there_is_no_map() -> None:
    verdict = verdict_on(make_site(flat, on_earth=False, home=None), LINE)
    with pytest.raises(InputError, match="scenario test has no position on Earth"):
        gaps_geojson(verdict.coverage, list(verdict.gaps))
