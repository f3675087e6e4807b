"""The problems that two publications have in their repositories; their data is read from a folder that the user names."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scripts.mcpp.problems import HEADINGS, NORTH, Place, Problem, connected

LS_MCPP = (
    "real", "floor_small", "terrain_small", "floor_medium", "terrain_medium", "floor_large", "terrain_large",
    "ht_chantry", "ost002d", "AR0701SR", "AR0205SR", "Shanghai2", "NewYork1",
)  # fmt: skip
"""Their base instances."""
_PIXELS_PER_CELL = 10
"""The ``map_scale`` of their launch file."""
_FREE_BELOW = 0.196
"""The ``free_thresh`` of their map.yaml, of darkness."""
_LAUNCHED = ((2, 2), (2, 40), (40, 2), (40, 40), (22, 22))
"""Where their launch file has five robots, on random_20_10, in cells."""


def read_ls_mcpp(data: Path, name: str) -> Problem:
    """An instance of LS-MCPP: moves cost 1, or as much as its random numbers say; a quarter turn costs a half.

    Robots that begin at one place count as one, because their program takes them for one. Where robots of an instance begin
    outside its map, its first variation (``NAME/0.000-0``) stands for it: the same map with other places.

    Args:
        data: their folder of that name.
        name: one of :data:`LS_MCPP`, or of a variation.

    Raises:
        ValueError: a file is not as theirs are.
    """
    text = (data / "instances" / f"{name}.mcpp").read_text(encoding="utf-8")
    folder = _value(text, "map")
    lines = (data / "gridmaps" / f"{name if '/' in name else folder}.map").read_text(encoding="utf-8").splitlines()
    height, width = int(lines[1].split()[1]), int(lines[2].split()[1])
    free = [(column, row) for row in range(height) for column in range(width) if lines[4 + row][column] == "."]
    listed = re.search(r"^root:\s*\[(.*?)\]\s*\n\w", text + "\nend", re.MULTILINE | re.DOTALL)
    if listed is None:
        raise ValueError(f"{name}.mcpp has no roots")
    robots = list(dict.fromkeys((int(x), int(y)) for x, y in re.findall(r"\[(\d+),\s*(\d+)\]", listed[1])))
    places = connected(set(free), robots)
    if not places.issuperset(robots):
        if "/" in name:
            raise ValueError(f"robots of {name} begin outside its map")
        return read_ls_mcpp(data, f"{name}/0.000-0")
    prices: dict[frozenset[Place], float] = {}
    draw = np.random.RandomState(int(_value(text, "weight_seed", "0")))
    low, high = (float(end) for end in _value(text, "weight_range", "[1, 3]").strip("[]").split(","))
    digits = _value(text, "weight_precision", "")
    weighted, exists = _value(text, "weighted") == "True", set(free)
    # Theirs are drawn for each move in both directions, and the last one counts.
    for x, y in free:
        for u, v in HEADINGS:
            if (x + u, y + v) in exists:
                price = float(draw.uniform(low, high)) if weighted else 1.0
                prices[frozenset(((x, y), (x + u, y + v)))] = round(price, int(digits)) if digits else price
    reached = {move: price for move, price in prices.items() if move <= places}
    return Problem(name, reached, robots, quarter=0.5, half=1.0, facing=NORTH)


def _value(text: str, key: str, default: str | None = None) -> str:
    found = re.search(rf"^{key}:\s*(.+?)\s*$", text, re.MULTILINE)
    if found is None and default is None:
        raise ValueError(f"the instance has no {key}")
    return default or "" if found is None else found[1]


def read_tmstc(maps: Path, name: str) -> Problem:
    """A map of TMSTC*: moves cost 1 and every turn costs 2 (``ONE_TURN_VAL``).

    Cells are free where all their pixels are, and count where all four cells of a block of two by two do, as in their program;
    of these, those that are connected with most others. Five robots are where their launch file has them on its map, elsewhere
    in the corners and the middle: at the cells that are nearest to these.

    Args:
        maps: their folder ``map``.
        name: of an image in it.
    """
    with Image.open(maps / name) as image:
        pixels = np.asarray(image.convert("RGB")).mean(axis=2)
    cells = _whole(pixels[::-1] > 255.0 * (1.0 - _FREE_BELOW), _PIXELS_PER_CELL)
    rows, columns = cells.shape
    blocks = _largest({(int(x), int(y)) for y, x in np.argwhere(_whole(cells, 2))})
    places = sorted((2 * x + i, 2 * y + j) for x, y in blocks for i in (0, 1) for j in (0, 1))
    corners = [(x, y) for x in (0, columns - 1) for y in (0, rows - 1)]
    wanted = _LAUNCHED if name.startswith("random_20_10") else [*corners, (columns // 2, rows // 2)]
    robots: list[Place] = []
    for x, y in wanted:
        apart = {place: abs(place[0] - x) + abs(place[1] - y) for place in places if place not in robots}
        robots.append(min(apart, key=lambda place: (apart[place], place[::-1])))
    exists = set(places)
    prices = {
        frozenset(((x, y), (x + u, y + v))): 1.0 for x, y in places for u, v in HEADINGS if (x + u, y + v) in exists
    }
    return Problem(name, prices, robots, quarter=2.0, half=2.0, facing=None)


def _whole(free: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """Blocks of so many by so many of which all is free; what is left at the far edges is in none."""
    rows, columns = free.shape[0] // size, free.shape[1] // size
    blocks = free[: rows * size, : columns * size].reshape(rows, size, columns, size)
    return np.asarray(blocks.all(axis=(1, 3)))


def _largest(places: set[Place]) -> set[Place]:
    left, best = set(places), set[Place]()
    while left:
        part = connected(left, [min(left, key=lambda place: place[::-1])])
        left -= part
        best = part if len(part) > len(best) else best
    return best
