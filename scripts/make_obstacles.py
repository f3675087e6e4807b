"""Write uavcover/data/ridge-obstacles.csv: sixty boxes for the bundled scenario ridge-obstacles. Seeded: always the same file.

.venv/bin/python scripts/make_obstacles.py
"""

import argparse
import csv
import math
from pathlib import Path

import numpy as np

OUT = Path(__file__).resolve().parents[1] / "uavcover" / "data" / "ridge-obstacles.csv"
BOXES = 60
SIDE_M = 1000.0
INSET_M = 30.0
APART_M = 45.0
"""Between the middles of two boxes: a corner is at most 18 m from the middle, so there is always a way between them."""
HOME_M = (470.0, -470.0)
FROM_HOME_M = 60.0


def main() -> None:
    """Draw places until sixty are far enough from each other and from the take-off place."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rng = np.random.default_rng(60)
    middles: list[tuple[float, float]] = []
    reach = 0.5 * SIDE_M - INSET_M
    while len(middles) < BOXES:
        east, north = (round(float(value), 1) for value in rng.uniform(-reach, reach, 2))
        near = any(math.dist((east, north), other) < APART_M for other in middles)
        if not near and math.dist((east, north), HOME_M) >= FROM_HOME_M:
            middles.append((east, north))
    with OUT.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "east_m", "north_m", "length_m", "width_m", "heading_deg", "height_m"])
        for number, (east, north) in enumerate(middles, start=1):
            length, width, heading, height = (
                round(float(rng.uniform(low, high)), 1) for low, high in ((12, 30), (8, 20), (0, 180), (10, 25))
            )
            writer.writerow([f"box {number}", east, north, length, width, heading, height])


if __name__ == "__main__":
    main()
