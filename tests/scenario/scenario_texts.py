"""A scenario as text, read, or refused for one mistake after the other."""

from pathlib import Path

import pytest

from uavcover.errors import ScenarioError
from uavcover.scenario.scenario_file import parse_scenario

GOOD = """
name = "test"
select = "knee"

[area]
polygon_lon_lat_deg = [[-84.22, 36.47], [-84.21, 36.47], [-84.21, 36.48], [-84.22, 36.48]]
holes_lon_lat_deg = [[[-84.218, 36.472], [-84.216, 36.472], [-84.216, 36.474]]]
cell_size_m = 5

[terrain]
kind = "raster"
file = "dem.tif"
vertical_datum = "EGM96"

[home]
lat_deg = 36.471
lon_deg = -84.216

[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 200.0

[limits]
min_height_agl_m = 40.0
max_height_agl_m = 120.0

[vehicle]
cruise_speed_m_s = 10.0

[planner]
seed = 7
"""
FOLDER = Path("/somewhere")


def survey_text(area, file, home):
    """A survey over elevation files; the area and the files are TOML, home a latitude and a longitude."""
    return f"""
name = "a"
[area]
{area}
cell_size_m = 10.0
[terrain]
kind = "raster"
file = {file}
vertical_datum = "EGM96"
[home]
lat_deg = {home[0]}
lon_deg = {home[1]}
[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 200.0
[limits]
min_height_agl_m = 40.0
max_height_agl_m = 120.0
"""


def parse(text, folder=FOLDER):
    return parse_scenario(text, source="mine.toml", folder=folder)


def refused(*changes, text=GOOD, folder=FOLDER):
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    with pytest.raises(ScenarioError) as caught:
        parse(text, folder)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("mine.toml: ")
    # None of the words of the machinery.
    for word in (
        "NadirCamera",
        "SphereSensor",
        "RasterTerrain",
        "Value error",
        "Input should",
        "pydantic",
        "Unexpected",
    ):
        assert word not in message
    return message.removeprefix("mine.toml: ")
