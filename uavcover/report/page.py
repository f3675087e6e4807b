"""The report of a run, as ``report`` and ``demo`` write it: one HTML file that opens offline."""

import base64
import hashlib
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from mission_io.model.plain_text import plain_lines, plain_values
from uavcover.errors import InputError, OutputError
from uavcover.report import plots
from uavcover.report.background import Background, read_background
from uavcover.report.content import FIGURES, ReportContent, bounds_m, read_run
from uavcover.report.map_data import REASON_TEXTS, drawn_every, map_data
from uavcover.run.documents import bounds_text
from uavcover.run.folder import REPORT_FILE, RunFolder, write_text
from uavcover.run.judged_inputs import (
    accepted_in,
    inspect_inputs,
    judged_logs,
    logs_of_the_verdict,
    refuse_changes,
    same_inputs,
    unsealed_text,
    was_flown,
)
from uavcover.run.provenance import note_files
from uavcover.run.user import Unattended, User, to_paste
from uavcover.sensing.photos import OVERLAP_FRACTION, overlap_rule
from uavcover.verification.decision import requirement_rows

_HERE = Path(__file__).parent
_PAGE = _HERE / "page"
_LEAFLET = _HERE / "vendor" / "leaflet"


BOUND_TEXTS = {
    "coverable_fraction": "fraction of the area that permitted positions can observe",
    "length_reference_m": "area divided by swath width (an estimate, not a bound)",
}


def render_report(content: ReportContent, background: Background | None = None) -> str:
    """Render the page, with a map of the user's own behind its map where there is one."""
    return rendered_page(
        _PAGE / "report.html",
        own_script="\n".join(_read(_PAGE / name) for name in ("map.js", "view3d.js", "charts.js")),
        data=map_data(content) | {"background": None if background is None else background.image},
        facts={"background": background, **_facts(content)},
    )


def map_script() -> str:
    """The script of a page that has the map alone."""
    return _read(_PAGE / "map.js") + "\nreport.start();\n"


def page_environment(*folders: Path) -> jinja2.Environment:
    """The templates of some folders; texts are escaped, and unknown names are errors."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(folders), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip


def hash_source(text: str) -> str:
    """A script or style in the words of a content security policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def rendered_page(template: Path, *, own_script: str, data: dict[str, Any], facts: dict[str, Any]) -> str:
    """A page with a map in one file that opens offline.

    Content from files is escaped and has no control characters; only our own scripts may run, by their hashes.

    Args:
        template: its file; it may include those of the report.
        own_script: runs after Leaflet's.
        data: for the script, as JSON.
        facts: for the template.
    """
    environment = page_environment(template.parent, _PAGE)
    environment.filters |= {"percent": _percent, "metres": _metres, "duration": _duration}
    leaflet = re.sub(r"^//# sourceMappingURL=.*$", "", _read(_LEAFLET / "leaflet.js"), flags=re.MULTILINE)
    scripts = [leaflet, own_script]
    # Without Leaflet's button pictures, which the page does not use and the browser would request from the network.
    style = re.sub(r"url\([^)]*\)", "none", _read(_LEAFLET / "leaflet.css")) + _read(_PAGE / "report.css")
    return plain_lines(
        environment.get_template(template.name).render(
            scripts=[Markup(script) for script in scripts],
            style=Markup(style),
            policy=f"default-src 'none'; img-src data:; script-src {' '.join(map(hash_source, scripts))}; "
            "style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'",
            leaflet_licence=_read(_LEAFLET / "LICENSE"),
            data=plain_values(data),
            version=metadata.version("uavcover"),
            **facts,
        )
    )


def _facts(content: ReportContent) -> dict[str, Any]:
    verdict, site = content.verdict, content.site
    report = None if verdict is None else verdict.report
    baselines = _baselines(content.plan)
    floor = plots.choice_floor(content)
    charts = [plots.elevation_profile(content), plots.height_along_route(content)]
    if verdict is not None:
        charts += [plots.height_over_time(content, verdict), plots.coverage_over_time(content, verdict)]
    return {
        "scenario": site.scenario,
        "site": site,
        "plan": content.plan,
        "planned": content.planned,
        "planned_tiles": [] if report is not None else _planned_tiles(content),
        "flights": content.flights,
        "report": report,
        "notices": content.notices,
        "requirements": [] if report is None else requirement_rows(site.scenario, report),
        "charts": charts,
        "pareto": plots.pareto_front(content),
        "members": content.members,
        "bounds": _bounds(content.plan),
        "baselines": [b for b in baselines if b["coverage_of_coverable"] >= floor],
        "lesser_baselines": [b for b in baselines if b["coverage_of_coverable"] < floor],
        "picture_rows": [
            (name, statistics)
            for name, statistics in (
                ("planned", content.planned_view.statistics),
                ("flown", None if report is None else report.pictures),
            )
            if statistics is not None
        ],
        "overlap_rule": overlap_rule(site.scenario.sensor),
        "overlap_fraction": OVERLAP_FRACTION,
        "upload": content.upload,
        "about": content.about,
        "commands": _commands(content.about, content.plan),
        "reason_words": REASON_TEXTS,
        "drawn_every": max((drawn_every(len(flight.track)) for flight in content.flights), default=1),
        "duration_s": sum(flight.duration_s for flight in content.flights),
        "max_rows": FIGURES.max_table_rows,
    }


def _planned_tiles(content: ReportContent) -> list[tuple[str, str]]:
    """Figures of the planned flight, and the origin of its route."""
    mission, photos = content.plan.get("mission"), content.planned_view.statistics
    rows = []
    if isinstance(mission, dict):
        rows = [
            ("Flights", str(mission["sorties"])),
            ("First take-off to last landing", _duration(mission["makespan_s"])),
        ]
    if photos is not None:
        rows.append(("Photos", str(photos.taken)))
        if photos.ground_sample_median_m is not None:
            rows.append(("Ground sample distance, median", f"{100.0 * photos.ground_sample_median_m:.2f} cm"))
    return [*rows, ("Route made by", str(content.plan.get("made_by", "unknown")))]


def _bounds(plan: dict[str, Any]) -> list[tuple[str, str]]:
    """The bounds in words; one that this version does not know keeps its own name."""
    bounds = plan.get("bounds", {})
    figures = [
        (BOUND_TEXTS.get(name, name), _figure(name, value))
        for name, value in bounds.items()
        if not isinstance(value, dict)
    ]
    return figures + [("proved bound", line) for line in bounds_text(bounds)]


def _figure(name: str, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if name.endswith("_fraction"):
        return _percent(value)
    return _metres(value, 0) if name.endswith("_m") else f"{value:.6g}"


def _baselines(plan: dict[str, Any]) -> list[dict[str, Any]]:
    """The baselines from shortest to longest, without duplicates."""
    unique: dict[tuple[Any, ...], dict[str, Any]] = {}
    for baseline in plan.get("baselines", []):
        unique.setdefault((baseline["coverage_of_coverable"], baseline["path_length_m"]), baseline)
    return sorted(unique.values(), key=lambda baseline: float(baseline["path_length_m"]))


def _commands(about: dict[str, Any], plan: dict[str, Any]) -> list[str]:
    """Commands that reproduce this plan from the scenario beside the report."""
    packages = about.get("packages", {})
    version = packages.get("uavcover") if isinstance(packages, dict) else None
    lines = [f"# planned with uavcover {version}"] if version else []
    lines.append(
        f"uavcover plan scenario.toml -o again --algorithm {plan.get('algorithm')} --seed {plan.get('seed')} "
        f'--evaluations {plan.get("evaluations")} --select "{plan.get("select")}"'
    )
    return lines


def _percent(fraction: float | None, digits: int = 2) -> str:
    return "–" if fraction is None else f"{100.0 * fraction:.{digits}f} %"


def _metres(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:,.{digits}f} m".replace(",", "\u202f")


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "–"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8")


VERDICT = "verification.json"


def write_report(
    run: str | Path,
    path: str | Path | None = None,
    *,
    logs: Sequence[str | Path] = (),
    background: str | Path | None = None,
) -> Path:
    """Write the report of a run folder, one HTML file that opens offline, as ``uavcover report`` does.

    Args:
        run: the run folder.
        path: the file. Default: ``report.html`` in the run folder.
        logs: what was flown. Default: the run's tracks.
        background: a GeoTIFF or MBTiles file to lie behind the map.

    Returns:
        The file.
    """
    folder = RunFolder(run)
    to = folder.file(REPORT_FILE) if path is None else Path(path)
    behind = None if background is None else Path(background)
    save_report(folder, to, Unattended(), logs=[Path(log) for log in logs], background=behind)
    return to


def save_report(
    run: RunFolder, path: Path, user: User, *, logs: Sequence[Path] = (), background: Path | None = None
) -> ReportContent:
    """Write the report of a run folder to a file.

    It follows from other files, so it may replace an older one.

    Raises:
        InputError: a file of the run is missing or broken.
        OutputError: the report cannot be written.
    """
    of_run = path.resolve() == run.file(REPORT_FILE).resolve()
    if of_run and run.file(REPORT_FILE).exists():
        run.remove([REPORT_FILE])  # a report that is refused leaves no older one behind
    logs = list(logs) or _logs_of_the_verdict(run, user)
    notices = standing(run, logs)
    with user.progress("reporting"):
        content = read_run(run, logs=logs, notices=notices)
        behind = None if background is None else read_background(background, content.site, bounds_m(content.site))
        text = render_report(content, behind)
    for warning in (*content.notices, *content.warnings):
        user.warn(warning)
    write_text(path, text)
    if of_run:
        note_files(run, "report", [REPORT_FILE], command=sys.argv)
    user.say(f"wrote {path} ({len(text.encode()) / 1e6:.1f} MB)")
    return content


def _logs_of_the_verdict(run: RunFolder, user: User) -> list[Path]:
    """Logs that the verdict judged, with those of gaps; the run's own tracks if they no longer exist."""
    try:
        return logs_of_the_verdict(run)
    except InputError as error:
        user.warn(str(error))
        return []


def standing(run: RunFolder, logs: Sequence[Path]) -> list[str]:
    """Notes on differences between the report and ``verification.json``.

    Raises:
        InputError: something changed since planning or flight, and no verdict has accepted it.
    """
    flown = judged_logs(run, logs) if logs or was_flown(run) else []
    inputs = inspect_inputs(run, flown)
    verdict = run.read_json(VERDICT, made_by="uavcover verify") if run.file(VERDICT).is_file() else None
    accepted = set() if verdict is None else accepted_in(verdict)
    left = replace(inputs, changes=tuple(c for c in inputs.changes if c not in accepted))
    refuse_changes(run, left, (), who_accepts=to_paste("verify", run))
    notices = [f"accepted change since planning or flight: {change}" for change in inputs.changes]
    notices += [unsealed_text(name) for name in inputs.unsealed]
    if flown and verdict is None:
        notices.append("the run folder contains no verdict from uavcover verify, so this report contains its own")
    elif verdict is not None and not same_inputs(verdict, inputs):
        notices.append("verification.json was computed from different inputs; run uavcover verify again")
    return notices


def draw_figures(content: ReportContent, folder: Path, user: User, *, force: bool) -> list[Path]:
    """Draw the figures of a run into a folder.

    Raises:
        OutputError: a figure already exists and ``force`` is not set, or cannot be written.
    """
    there = [name for name in plots.FIGURE_NAMES if (folder / name).exists()]
    if there and not force:
        raise OutputError(
            f"{folder}: this folder already contains {', '.join(there)}; use --force to overwrite, or "
            "choose another folder"
        )
    drawn = plots.save_figures(content, folder)
    user.say(f"wrote {', '.join(str(path) for path in drawn)}")
    return drawn
