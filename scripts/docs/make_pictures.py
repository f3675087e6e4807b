"""Pictures for the documentation: HTML pages in a headless Chromium, and images of other commands, as WebP.

Usage, after a demo into the folder DEMO, a plan of a survey into PLAN and a flight of it with findings into FLOWN
(Debian, Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1 chromium):

    uavcover inspect DEMO --screenshot recording.png --at 0.55
    uavcover pareto PLAN --plot trade-off.png
    uavcover export PLAN --format print -o print.html
    uavcover check PLAN/mission.waypoints --dem DEM --max-height 100m --map check.html
    .venv/bin/python scripts/docs/make_pictures.py docs/pictures demo-report=DEMO/report.html [NAME=FILE ...]

The names are demo-report, plan-report and findings-report (of FLOWN), print-page, check-page, demo-recording, trade-off.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from PIL import Image

from scripts.options import existing_file, existing_folder

ROOT = Path(__file__).parents[2]
SETTLE = "new Promise(done => setTimeout(done, 1500))"
LAYER = """(() => {
    const labels = [...document.querySelectorAll('.leaflet-control-layers-base label')];
    const label = labels.find(l => l.textContent.includes('Photos per point'));
    if (label) label.querySelector('input').click();
})()"""
"""Shows the photos per point on the map of a survey."""
WIDTH, MOST_HEIGHT, PHONE = 1200, 1500, 390
QUALITY = 78


def named(text: str) -> tuple[str, Path]:
    """NAME=FILE."""
    name, _, file = text.partition("=")
    return name, existing_file(file)


def save(picture: Path, out: Path, width: int) -> None:
    """The upper part of a picture as WebP."""
    image = Image.open(picture).convert("RGB")
    if image.width > width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    image.crop((0, 0, image.width, min(image.height, MOST_HEIGHT))).save(out, quality=QUALITY, method=6)
    print(f"written: {out}")


def main() -> None:
    """Write NAME.webp for each page and image, and demo-report-phone.webp."""
    sys.path.insert(0, str(ROOT))
    from tests.report.browser import chromium_page

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=existing_folder, metavar="DIR")
    parser.add_argument("sources", nargs="+", type=named, metavar="NAME=FILE")
    requested = parser.parse_args()
    with tempfile.TemporaryDirectory() as profile, chromium_page(Path(profile)) as page:
        shot = Path(profile) / "shot.png"
        for name, file in requested.sources:
            if file.suffix != ".html":
                save(file, requested.folder / f"{name}.webp", WIDTH)
                continue
            for width in (WIDTH, PHONE) if name == "demo-report" else (WIDTH,):
                page.open(file, width=width)
                page.run(LAYER)
                page.run(SETTLE)
                ending = "-phone" if width == PHONE else ""
                save(page.screenshot(shot), requested.folder / f"{name}{ending}.webp", width)
        if page.complaints:
            raise SystemExit(f"the browser complains: {page.complaints}")


if __name__ == "__main__":
    main()
