"""Pictures of reports in a headless Chromium: the top of one by light, by dark and on a phone, and the maps of others.

Usage, after a demo into the folder RUN (Debian, Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1 chromium):

    uavcover inspect RUN --screenshot docs/pictures/demo-recording.png --at 0.55 --force
    uavcover report RUN -o report.html
    .venv/bin/python scripts/docs/make_pictures.py report.html docs/pictures [NAME=REPORT.html ...]
"""

import argparse
import base64
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from scripts.options import existing_file, existing_folder

ROOT = Path(__file__).parents[2]
SETTLE = "new Promise(done => setTimeout(done, 1500))"
TOP = (0, 0, 1200, 1900)
PHONE = (0, 0, 390, 1500)
SCREENS = ((1400, 900, "Photos per point, flown"), (390, 844, "Coverage"))
"""Widths and heights of the pictures of maps, and the layer that each shows."""

SHOW = """(() => {{
    const layers = [...document.querySelectorAll('.leaflet-control-layers-base label')];
    const layer = layers.find(l => l.textContent.includes({layer!r}));
    if (layer) layer.querySelector('input').click();
    [...document.querySelectorAll('h2')].find(h => h.textContent === 'Map').scrollIntoView();
}})()"""


def named_report(text: str) -> tuple[str, Path]:
    """NAME=REPORT.html."""
    name, _, report = text.partition("=")
    return name, existing_file(report)


def main() -> None:
    """Draw demo-report.png, demo-report-dark.png, demo-report-phone.png, and report-NAME-WIDTH.webp of the named reports."""
    sys.path.insert(0, str(ROOT))
    from tests.report.browser import chromium_page

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=existing_file, metavar="REPORT.html")
    parser.add_argument("folder", type=existing_folder, metavar="DIR")
    parser.add_argument("others", nargs="*", type=named_report, metavar="NAME=REPORT.html")
    asked = parser.parse_args()
    page_file, out = asked.report, asked.folder
    with tempfile.TemporaryDirectory() as profile, chromium_page(Path(profile)) as page:
        for name, colors, width, box in (
            ("demo-report", "light", 1200, TOP),
            ("demo-report-dark", "dark", 1200, TOP),
            ("demo-report-phone", "light", 390, PHONE),
        ):
            page.open(page_file, width=width, colors=colors)
            page.run(SETTLE)
            png = page.screenshot(out / f"{name}.png")
            Image.open(png).crop(box).quantize(96).save(png, optimize=True)
            print(f"written: {png}")
        for name, report in asked.others:
            for width, height, layer in SCREENS:
                page.open(report, width=width, height=height)
                page.run(SHOW.format(layer=layer))
                page.run(SETTLE)
                shown = Image.open(io.BytesIO(base64.b64decode(page.view())))
                shown.convert("RGB").save(out / f"report-{name}-{width}.webp", quality=82, method=6)
                print(f"written: {out / f'report-{name}-{width}.webp'}")
        if page.complaints:
            raise SystemExit(f"the browser complains: {page.complaints}")


if __name__ == "__main__":
    main()
