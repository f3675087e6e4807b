"""The four steps of the page as a pilot goes through them: for pictures of the documentation and for tests of every step."""

from collections.abc import Iterator

from tests.extras.app.browser import Page

SIZES = ((1400, 900), (1180, 820), (390, 844))
"""A desk, a tablet, a phone."""
FORM = (("dem", "jacksboro.tif"), ("vertical_datum", "EGM96"), ("camera", "dji-m3e"), ("vehicle", "dji-m3e"))
POSITIONS = ("36.4738, -84.2090", "36.4700, -84.2105")


def steps(
    p: Page, *, scenario: str = "survey.toml", vehicles: int = 2, budget: str = "10s", mock_speed: str = "8"
) -> Iterator[str]:
    """The name of each step, when the page shows it; in a folder with jacksboro.tif and the documentation's examples."""
    page = p.page
    page.evaluate("() => window.uavcover.loadArea('valley.geojson')")
    p.until("window.uavcover.state.draft.area")
    page.evaluate("() => window.uavcover.state.redraw()")
    for name, value in FORM:
        if page.locator(f"#f-{name} option[value='{value}']").count():
            page.select_option(f"#f-{name}", value)
    page.fill("#f-gsd", "4cm")
    page.fill("#f-battery", "30min")
    page.fill("#f-position", POSITIONS[0])
    page.click("text=Take off at this position")
    p.until("window.uavcover.state.draft.home")
    page.fill("#f-position", POSITIONS[1])
    page.click("text=Add rally point at this position")
    p.until("window.uavcover.state.draft.rally.length && window.uavcover.state.design?.flights")
    page.fill("#f-position", "")
    yield "area"
    page.select_option("#f-open", scenario)
    p.until("window.uavcover.state.scene")
    page.click("#tab-plan")
    page.select_option("#f-budget", budget)
    page.fill("#f-vehicles", str(vehicles))
    page.click("#plan")
    p.until("window.uavcover.state.scene?.plan && document.getElementById('schedule')")
    yield "plan"
    page.click("#tab-fly")
    page.click("#upload")
    p.until("document.getElementById('uploaded')")
    page.fill("#f-mock", mock_speed)
    page.click("#fly")
    p.until("[...window.uavcover.state.live.values()].filter((live) => live.line && live.count > 60).length >= 2")
    yield "fly"
    p.until("window.uavcover.state.tab === 'judge' && document.getElementById('verdict')")
    page.click("#verify")
    p.job_ended("verify")
    page.click("#gaps")
    p.job_ended("gaps")
    yield "judge"
