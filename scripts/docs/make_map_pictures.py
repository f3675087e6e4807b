"""Make the pictures of docs/how-to/map.md with Chromium: `python scripts/docs/make_map_pictures.py -o docs/pictures`.

Each step is a picture of its own at 1400 x 900; all four are together on one for a tablet and on one for a phone.
"""

import argparse
import io
import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[2]
SHEETS = {"tablet": (2, 0.6), "phone": (4, 0.8)}
"""Columns of a sheet, and its scale."""
GAP = 12


def main() -> None:
    """Drive the page and write its pictures."""
    sys.path.insert(0, str(ROOT))
    from tests.extras.app.browser import CHROMIUM, SOFTWARE, opened
    from tests.extras.app.conftest import serving
    from tests.extras.app.steps import SIZES, steps

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the pictures")
    out = parser.parse_args().out
    if not out.is_dir():
        parser.error(f"--out {out}: no such folder")
    shots: dict[tuple[int, int], list[Image.Image]] = {size: [] for size in SIZES}
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        folder = Path(shutil.copytree(ROOT / "docs" / "examples", Path(scratch) / "pictures"))
        shutil.copy(ROOT / "uavcover" / "data" / "jacksboro.tif", folder)
        shutil.copy(ROOT / "uavcover" / "scenarios" / "jacksboro.toml", folder)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        for served in serving(folder):
            p = opened(browser, served)
            for name in steps(p, scenario="jacksboro.toml", vehicles=3, budget="30s", mock_speed="5"):
                if name == "fly":
                    p.until("window.uavcover.state.covered.get('jacksboro') > 0.35")
                for width, height in SIZES:
                    p.page.set_viewport_size({"width": width, "height": height})
                    p.page.wait_for_timeout(700)
                    p.page.click("text=Show all")
                    p.page.wait_for_timeout(4000)
                    shots[width, height].append(Image.open(io.BytesIO(p.page.screenshot())).convert("RGB"))
                shots[SIZES[0]][-1].save(out / f"map-{name}.webp", quality=80, method=6)
                p.page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
        browser.close()
    for size, (kind, (columns, scale)) in zip(SIZES[1:], SHEETS.items(), strict=True):
        width, height = (round(scale * side) for side in size)
        rows = -(-len(shots[size]) // columns)
        sheet = Image.new("RGB", (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP), "white")
        for n, shot in enumerate(shots[size]):
            small = shot.resize((width, height), Image.Resampling.LANCZOS)
            sheet.paste(small, (n % columns * (width + GAP), n // columns * (height + GAP)))
        sheet.save(out / f"map-{kind}.webp", quality=80, method=6)


if __name__ == "__main__":
    main()
