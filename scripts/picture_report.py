"""Pictures of a report in a headless Chromium: the top of the page by light and by dark, and a phone's.

Usage: .venv/bin/python scripts/picture_report.py REPORT.html DIR
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
SETTLE = "new Promise(done => setTimeout(done, 1500))"
TOP = (0, 0, 1200, 1900)
PHONE = (0, 0, 390, 1500)


def main() -> None:
    """Draw demo-report.png, demo-report-dark.png and demo-report-phone.png."""
    sys.path.insert(0, str(ROOT))
    from tests.report.browser import chromium_page

    page_file, out = Path(sys.argv[1]), Path(sys.argv[2])
    with tempfile.TemporaryDirectory() as profile, chromium_page(Path(profile)) as page:
        for name, colors, width, box in (
            ("demo-report", "light", 1200, TOP),
            ("demo-report-dark", "dark", 1200, TOP),
            ("demo-report-phone", "light", 390, PHONE),
        ):
            page.open(page_file, width=width, colors=colors)
            page.run(SETTLE)
            png = page.screenshot(out / f"{name}.png")
            Image.open(png).crop(box).quantize(192).save(png, optimize=True)
            print(f"written: {png}")
        if page.complaints:
            raise SystemExit(f"the browser complains: {page.complaints}")


if __name__ == "__main__":
    main()
