"""The page as text: whole, self-contained, and nothing in it that came from a file as markup."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.recording.flights import lines_over
from tests.report.conftest import HOSTILE, coarse, read_of_perfect_tracks, write_run
from uavcover.errors import InputError
from uavcover.report.content import ReportContent, read_run
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site


class Elements(HTMLParser):
    """Every start tag with its attributes, the scripts, and the text outside them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[str | None, str]] = []
        self.text = ""
        self._script: str | bool | None = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._script = dict(attrs).get("type") if tag == "script" else False

    def handle_data(self, data: str) -> None:
        if self._script is False:
            self.text += data
        else:
            self.scripts.append((self._script, data))  # type: ignore[arg-type]

    def handle_endtag(self, tag: str) -> None:
        del tag
        self._script = False

    def table(self, heading: str) -> str:
        return self.text.split(heading)[1]


def test_nothing_is_asked_of_anybody(html: str) -> None:
    page = Elements(html)
    for tag, attributes in page.tags:
        assert tag not in {"link", "iframe", "object", "embed", "base", "img"}, tag
        assert not {"src", "srcset", "action"} & set(attributes), (tag, attributes)
    assert "url(" not in html.split("</style>")[0]
    assert "sourceMappingURL" not in html


def test_only_our_scripts_may_run(html: str) -> None:
    page = Elements(html)
    policy = next(
        a["content"] for t, a in page.tags if t == "meta" and a.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None
    assert policy.startswith("default-src 'none'; img-src data:; ")
    running = [script for kind, script in page.scripts if kind is None and script.strip()]
    assert len(running) == 2
    for script in running:
        assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() in policy
    assert not [a for _, a in page.tags if any(name.startswith("on") for name in a)]


def test_the_verdict_is_the_one_of_verification(html: str, content: ReportContent) -> None:
    assert content.verdict is not None
    report = content.verdict.report
    page = Elements(html)
    assert not report.passed
    assert report.verdict == "failed"
    assert "Failed" in page.text
    assert report.doubts
    assert all(line in page.text for line in (*report.reasons, *report.doubts, *report.findings))
    assert f"{report.unobserved_s:.1f} s" in page.text
    assert f"{100.0 * report.coverage_fraction:.2f} %" in page.text
    assert f"{report.gaps[0].area_m2:.0f} m²" in page.table("Coverage gaps")
    assert "--seed 3 --evaluations 40" in page.text
    assert "Leaflet licence" in page.text
    assert "Volodymyr Agafonkin" in page.text
    assert len(html.encode()) < 3_000_000


def test_what_comes_from_files_is_text(tmp_path: Path) -> None:
    hostile = coarse("jacksboro", 100.0, description=HOSTILE)
    run = write_run(tmp_path / "run", hostile, lines_over(hostile, spacing_m=300.0, count=2), flown=True, name=HOSTILE)
    for name in ("run.json", "plan.json"):
        document = json.loads(run.file(name).read_text())
        document |= {"packages": {HOSTILE: HOSTILE}, "stages": {HOSTILE: {"wall_s": 1.0}}, "select": HOSTILE}
        if name == "plan.json":
            document |= {"name": HOSTILE, "algorithm": HOSTILE, "bounds": {HOSTILE: HOSTILE}, "made_by": HOSTILE}
        run.file(name).write_text(json.dumps(document))
    log = tmp_path / "<img src=x onerror=window.hacked=1>.csv"
    log.write_bytes(run.file("track.csv").read_bytes())
    html = render_report(read_run(run, logs=[log]))
    page = Elements(html)
    assert not [tag for tag, _ in page.tags if tag == "img"]
    assert len(page.scripts) == 3
    assert page.text.count(HOSTILE) >= 7
    assert log.name in page.text
    assert "49" not in re.findall(r"<!--(.*?)&amp;", html)


def test_a_plan_that_was_not_flown(site: Site, tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", site, lines_over(site, spacing_m=300.0, count=2), flown=False)
    page = Elements(render_report(read_run(run, logs=())))
    assert "Planned, not flown yet" in page.text
    assert "Requirements" not in page.text
    assert "Coverage gaps" not in page.text


def test_a_scenario_without_a_place_on_earth(tmp_path: Path) -> None:
    scenario = load_scenario("paper-R2")
    site = coarse("paper-R2", 0.5, limits=scenario.limits)
    run = write_run(tmp_path / "run", site, lines_over(site, spacing_m=2.0, count=3), flown=False)
    page = Elements(render_report(read_run(run, logs=())))
    assert "Latitude" not in page.text
    data = json.loads(next(text for kind, text in page.scripts if kind == "application/json"))
    assert data["geodetic"] is None
    assert data["home"] is None


def test_two_tracks_count_together(run: RunFolder, tmp_path: Path, content: ReportContent) -> None:
    header, *rows = run.file("track.csv").read_text().splitlines(keepends=True)
    half = len(rows) // 2
    logs = [tmp_path / "first.csv", tmp_path / "second.csv"]
    for log, part in zip(logs, (rows[:half], rows[half:]), strict=True):
        log.write_text(header + "".join(part))
    both = read_of_perfect_tracks(run, logs)
    assert both.verdict is not None
    assert content.verdict is not None
    assert both.verdict.report.coverage_fraction == pytest.approx(content.verdict.report.coverage_fraction, abs=0.02)
    page = Elements(render_report(both))
    assert "2 consecutive flights" in page.text
    assert "observed, of the area, first.csv" in page.text
    assert "observed, of the area, second.csv" in page.text


def test_no_plan_is_told(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(InputError, match="uavcover plan"):
        read_run(RunFolder(tmp_path / "run"), logs=())


def test_equal_runs_give_equal_pages(run: RunFolder, html: str) -> None:
    assert render_report(read_of_perfect_tracks(run)) == html
