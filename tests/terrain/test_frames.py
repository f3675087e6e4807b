import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from uavcover.errors import InputError
from uavcover.terrain.frames import LocalFrame

deterministic = settings(derandomize=True, deadline=None, max_examples=40)

# WGS 84, NIMA TR8350.2.
A_M, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)


def ecef_by_hand(lat_deg, lon_deg, alt_m):
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    n = A_M / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    return np.array(
        [
            (n + alt_m) * math.cos(lat) * math.cos(lon),
            (n + alt_m) * math.cos(lat) * math.sin(lon),
            (n * (1 - E2) + alt_m) * math.sin(lat),
        ]
    )


def enu_by_hand(frame, lat_deg, lon_deg, alt_m):
    lat, lon = math.radians(frame.lat_deg), math.radians(frame.lon_deg)
    east = [-math.sin(lon), math.cos(lon), 0.0]
    north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
    up = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
    return np.array([east, north, up]) @ (
        ecef_by_hand(lat_deg, lon_deg, alt_m) - ecef_by_hand(frame.lat_deg, frame.lon_deg, frame.alt_amsl_m)
    )


frames = st.builds(LocalFrame, st.floats(-89, 89), st.floats(-179, 179), st.floats(-400, 8000))


@deterministic
@given(frames, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-400, 9000))
def test_enu_equals_the_formulas_and_comes_back(frame, dlat, dlon, alt):
    lat, lon = frame.lat_deg + dlat, frame.lon_deg + dlon
    enu = frame.enu_from_geodetic(lat, lon, alt)
    assert enu.shape == (1, 3)
    np.testing.assert_allclose(enu[0], enu_by_hand(frame, lat, lon, alt), rtol=0, atol=1e-6)
    back_lat, back_lon, back_alt = frame.geodetic_from_enu(enu)
    assert back_lat[0] == pytest.approx(lat, abs=1e-11)
    assert back_lon[0] == pytest.approx(lon, abs=1e-10)
    assert back_alt[0] == pytest.approx(alt, abs=1e-6)


def test_enu_equals_epsg_geocentric_coordinates():
    frame = LocalFrame(36.4762, -84.216, 317.0)
    lat, lon, alt = np.array([36.49, 36.45]), np.array([-84.25, -84.19]), np.array([320.0, 980.5])
    to_ecef = Transformer.from_crs(4979, 4978, always_xy=True)
    delta = np.column_stack(to_ecef.transform(lon, lat, alt)) - np.array(
        to_ecef.transform(frame.lon_deg, frame.lat_deg, frame.alt_amsl_m)
    )
    enu = frame.enu_from_geodetic(lat, lon, alt)
    # A rotation: lengths and the angles between them stay.
    np.testing.assert_allclose(np.linalg.norm(enu, axis=1), np.linalg.norm(delta, axis=1), rtol=1e-12)
    assert enu[0] @ enu[1] == pytest.approx(delta[0] @ delta[1], rel=1e-10)
    # And north is north: the azimuth of the geodesic, to what curvature makes of 5 km.
    azimuth, _, distance = Geod(ellps="WGS84").inv(frame.lon_deg, frame.lat_deg, lon[0], lat[0])
    assert math.degrees(math.atan2(enu[0, 0], enu[0, 1])) == pytest.approx(azimuth, abs=1e-3)
    assert math.hypot(enu[0, 0], enu[0, 1]) == pytest.approx(distance * (1 + 317 / A_M), rel=2e-5)


def test_axes_by_hand():
    frame = LocalFrame(36.0, -84.0, 500.0)
    np.testing.assert_allclose(frame.enu_from_geodetic(36.0, -84.0, 500.0), [[0, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(frame.enu_from_geodetic(36.0, -84.0, 620.0), [[0, 0, 120]], atol=1e-9)
    north, east = frame.enu_from_geodetic([36.001, 36.0], [-84.0, -83.999], 500.0)
    assert north[1] == pytest.approx(110.96, abs=0.1)
    assert abs(north[0]) < 1e-9
    assert east[0] == pytest.approx(90.16, abs=0.1)
    # A degree of longitude is shorter than one of latitude: swapping them would show.
    assert north[1] - east[0] > 20.0


def test_numpy_numbers_make_the_same_frame():
    # Regression: their repr went into the pipeline.
    frame = LocalFrame(np.float64(36.5), np.float64(-84.2), np.float64(300.0))
    expected = LocalFrame(36.5, -84.2, 300.0).enu_from_geodetic(36.6, -84.1, 310.0)
    np.testing.assert_array_equal(frame.enu_from_geodetic(36.6, -84.1, 310.0), expected)


def test_across_the_date_line_and_at_a_pole():
    frame = LocalFrame(10.0, 179.9995, 0.0)
    assert frame.enu_from_geodetic(10.0, -179.9995, 0.0)[0, 0] == pytest.approx(109.6, abs=0.1)
    assert frame.geodetic_from_enu([[109.6, 0.0, 0.0]])[1][0] == pytest.approx(-179.9995, abs=1e-5)
    assert np.isfinite(LocalFrame(90.0, 0.0, 0.0).enu_from_geodetic(89.999, 45.0, 0.0)).all()


def test_what_is_not_finite_stays_so_and_spares_its_neighbours():
    frame = LocalFrame(36.5, -84.2, 300.0)
    enu = frame.enu_from_geodetic([36.5, math.nan, 36.5], [-84.2, -84.2, -84.2], [300.0, 300.0, math.nan])
    assert np.isfinite(enu).all(axis=1).tolist() == [True, False, False]
    lat, _, alt = frame.geodetic_from_enu([[1.0, 2.0, 3.0], [math.nan, 0.0, 0.0], [0.0, 0.0, math.nan]])
    assert (np.isfinite(lat) & np.isfinite(alt)).tolist() == [True, False, False]


def test_arguments_stay_as_they_are():
    lat = np.array([36.5, 36.6])
    lat.setflags(write=False)
    enu = LocalFrame(36.5, -84.2, 300.0).enu_from_geodetic(lat, -84.2, 300.0)
    enu.setflags(write=False)
    np.testing.assert_allclose(LocalFrame(36.5, -84.2, 300.0).geodetic_from_enu(enu)[0], lat, atol=1e-11)


@pytest.mark.parametrize(
    ("lat", "lon", "alt", "words"),
    [
        (-184.2, 36.5, 0.0, "origin: latitude -184.2 is outside -90 to 90 (swapped with longitude?)"),
        (36.5, 181.0, 0.0, "longitude must be between -180 and 180, not 181.0"),
        (math.nan, 0.0, 0.0, "latitude nan"),
        (0.0, math.inf, 0.0, "longitude must"),
        (0.0, 0.0, math.nan, "not a finite number"),
    ],
)
def test_impossible_origins_are_refused(lat, lon, alt, words):
    with pytest.raises(InputError) as caught:
        LocalFrame(lat, lon, alt)
    assert words in str(caught.value)


def test_one_place_alone_and_among_others_is_the_same_to_the_bit():
    rng, frame = np.random.default_rng(5), LocalFrame(36.51, -84.21, 300.0)
    lat, lon, alt = rng.uniform(36.0, 37.0, 500), rng.uniform(-85.0, -84.0, 500), rng.uniform(-100.0, 2000.0, 500)
    for k, value in enumerate([math.nan, math.inf, -math.inf, 91.0, -0.0]):
        lat[k] = lon[10 + k] = alt[20 + k] = value
    together = frame.enu_from_geodetic(lat, lon, alt)
    alone = [
        frame.enu_from_geodetic(*position) for position in zip(lat.tolist(), lon.tolist(), alt.tolist(), strict=True)
    ]
    assert np.vstack(alone).tobytes() == together.tobytes()
    back = np.hstack([frame.geodetic_from_enu(position) for position in together])
    assert back.tobytes() == np.array(frame.geodetic_from_enu(together)).tobytes()
