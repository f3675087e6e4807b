import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import Cli

DEM = "uavcover/data/jacksboro.tif"
AREA = "36.48,-84.22,1500"


def test_says_the_tiles_and_where_to_get_them(cli: Cli) -> None:
    ended = cli("terrain", AREA, code=0)
    for text in ("Copernicus_DSM_COG_10_N36_00_W085_00_DEM.tif", "N36W085.hgt", "EGM2008", "https://", "3DEP"):
        assert text in ended.out


def test_across_180_degrees_and_high_up(cli: Cli) -> None:
    sets = {one["name"]: one for one in cli("terrain", "179.9,71.1,-179.9,71.3", "--json").document["sets"]}
    assert sorted(sets["glo-30"]["tiles"]) == [
        "Copernicus_DSM_COG_10_N71_00_E179_00_DEM.tif", "Copernicus_DSM_COG_10_N71_00_W180_00_DEM.tif",
    ]  # fmt: skip
    assert sets["srtm-1"]["tiles"] == []
    assert sets["srtm-1"]["beyond"] == 2


def test_elevation_data_all_over_the_area_is_a_yes(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(DEM, tmp_path / "N36W085.tif")
    ended = cli("terrain", AREA, "--dem", tmp_path, "--json", code=0)
    assert ended.document["known_share"] == 1.0
    sets = {one["name"]: one for one in ended.document["sets"]}
    assert sets["glo-30"]["missing"] == sets["glo-30"]["tiles"]


@pytest.mark.parametrize("area", ["36.446,-84.22,1500", "36.45,-84.8,1500"])
def test_elevation_data_that_ends_in_or_before_the_area_is_a_no(cli: Cli, area: str) -> None:
    assert cli("terrain", area, "--dem", DEM, "--json", code=1).document["known_share"] < 1.0


def test_terrain_files_are_written_and_not_replaced(cli: Cli, tmp_path: Path) -> None:
    arguments = ("terrain", AREA, "--dem", DEM, "--dat", tmp_path / "TERRAIN")
    [(name, blocks)] = cli(*arguments, "--json", code=0).document["dat"].items()
    assert Path(name).name == "N36W085.DAT"
    data = Path(name).read_bytes()
    assert len(data) % 2048 == 0
    assert sum(any(data[at : at + 2048]) for at in range(0, len(data), 2048)) == blocks
    assert "already exists; use --force to overwrite" in cli(*arguments, code=2).error
    cli(*arguments, "--force", code=0)
    assert Path(name).read_bytes() == data


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (("nowhere.kml",), "nowhere.kml"),
        ((AREA, "--dat", "x"), "--dat: this option requires elevation data; add --dem"),
        ((AREA, "--dem", "nowhere"), "--dem: nowhere: no such file or folder"),
        ((AREA, "--around", "far"), "--around"),
        ((AREA, "--dem", DEM, "--dat", "x", "--spacing", "0"), "--spacing: must be 10 to 1000 m, not 0 m"),
        ((AREA, "--dem", DEM, "--dat", "x", "--spacing", "65535"), "--spacing: must be 10 to 1000 m, not 65535 m"),
        (("-60,-60,60,60",), "the area spans 14884 tiles of 1 degree; use a part"),
        (("36.45,-85.8,1500", "--dem", DEM, "--dat", "x"), "no height in any terrain block"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, arguments: tuple[str, ...], telling: str) -> None:
    assert telling in cli("terrain", *arguments, "-q", code=2).error
    assert not Path("x").exists()


def test_the_next_command_can_be_pasted(cli: Cli) -> None:
    """A list of numbers that begins with a minus had a space in front, which a shell drops."""
    assert "Next: uavcover terrain -70.1,-70,500 --dem FOLDER" in cli("terrain", "-70.1,-70,500").out
    text = "POLYGON ((8 46, 8.01 46, 8.01 46.01, 8 46))"
    assert f"Next: uavcover terrain '{text}' --dem FOLDER" in cli("terrain", text).out
