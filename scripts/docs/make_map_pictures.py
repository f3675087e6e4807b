"""Make the pictures of docs/how-to/map.md with Chromium: `python scripts/docs/make_map_pictures.py -o docs/pictures`."""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[2]
LARGE, TABLET, PHONE = (1400, 900), (1180, 820), (390, 844)
SIZES = {"map-area": LARGE, "map-plan": LARGE, "map-fly": TABLET, "map-judge": TABLET, "map-phone": PHONE}
FENCE = [[-84.218, 36.469], [-84.206, 36.469], [-84.206, 36.4775], [-84.218, 36.4775], [-84.218, 36.469]]
LIMIT_MS = 300_000


def until(page: Any, expression: str) -> None:
    """Wait until an expression of the page is true."""
    for _ in range(LIMIT_MS // 200):
        if page.evaluate(f"() => {{ try {{ return Boolean({expression}); }} catch {{ return false; }} }}"):
            return
        page.wait_for_timeout(200)
    raise TimeoutError(expression)


def shoot(page: Any, out: Path, name: str) -> None:
    """Write one picture as WebP."""
    width, height = SIZES[name]
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_timeout(500)
    page.click("text=Show all")
    page.wait_for_timeout(5000)
    png = out / f"{name}.png"
    page.screenshot(path=png)
    Image.open(png).save(out / f"{name}.webp", quality=80)
    png.unlink()


def main() -> None:
    """Drive the page and write its pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the pictures")
    out = parser.parse_args().out
    if not out.is_dir():
        parser.error(f"--out {out}: no such folder")
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        for file in (ROOT / "docs" / "examples").iterdir():
            shutil.copy(file, scratch)
        shutil.copy(ROOT / "uavcover" / "data" / "jacksboro.tif", Path(scratch) / "dem.tif")
        shutil.copy(ROOT / "uavcover" / "scenarios" / "jacksboro.toml", scratch)
        (Path(scratch) / "fence.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [FENCE]}))
        command = [sys.executable, "-m", "uavcover", "serve", scratch, "--port", "0", "--no-browser", "--json"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            url = json.loads(server.stdout.readline())["url"]
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"),
                args=["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
            )
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            page.goto(url)
            until(page, "document.documentElement.dataset.ready")
            page.set_input_files("#f-files", str(ROOT / "docs" / "examples" / "valley.geojson"))
            until(page, "window.uavcover.state.draft.area")
            for name, value in (("dem", "dem.tif"), ("vertical_datum", "EGM96"), ("camera", "dji-m3e")):
                page.select_option(f"#f-{name}", value)
            page.select_option("#f-fence", "fence.geojson")
            page.fill("#f-position", "36.4712, -84.2168")
            page.click("text=Rally point there")
            until(page, "window.uavcover.state.design?.flights")
            page.locator("#f-position").scroll_into_view_if_needed()
            shoot(page, out, "map-area")
            page.select_option("#f-open", "jacksboro.toml")
            until(page, "window.uavcover.state.scene")
            page.click("#tab-plan")
            page.select_option("#f-budget", "30s")
            page.fill("#f-vehicles", "3")
            page.click("#plan")
            until(page, "window.uavcover.state.scene.plan")
            shoot(page, out, "map-plan")
            page.click("#tab-fly")
            page.click("#upload")
            until(page, "document.getElementById('uploaded')")
            page.fill("#f-mock", "5")
            page.click("#fly")
            until(page, "window.uavcover.state.covered.get('jacksboro') > 0.4")
            shoot(page, out, "map-fly")
            until(page, "window.uavcover.state.tab === 'judge' && document.getElementById('verdict')")
            shoot(page, out, "map-judge")
            page.click("#tab-plan")
            shoot(page, out, "map-phone")
            browser.close()
        finally:
            server.terminate()
            server.wait(30)


if __name__ == "__main__":
    main()
