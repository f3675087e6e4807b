"""The report of a verdict on pictures, as ``judge-photos --report`` writes it: one HTML file that needs no network."""

from pathlib import Path
from typing import Any

from uavcover.errors import OutputError
from uavcover.extras.photos.photo_map import footprints_drawn_every, photo_map_data
from uavcover.extras.photos.photo_verdict import PhotoVerdict
from uavcover.report.cell_layers import REASON_WORDS
from uavcover.report.page import map_script, rendered_page
from uavcover.run.folder import write_text
from uavcover.run.user import User, percent
from uavcover.sensing.pictures import overlap_rule

_MAX_ROWS = 30
_HOLDS = {"yes": "yes", "no": "NO", "not proved": "not proved"}


def render_photo_report(verdict: PhotoVerdict) -> str:
    """The page; names of files are escaped."""
    told = verdict.document
    return rendered_page(
        Path(__file__).parent / "photos.html",
        own_script=map_script(),
        data=photo_map_data(verdict),
        facts={
            "site": verdict.site,
            "scenario": verdict.site.scenario,
            "told": told,
            "rows": _requirements(verdict),
            "gaps": [region.gap for region in verdict.gaps],
            "reason_words": REASON_WORDS,
            "drawn_every": footprints_drawn_every(verdict),
            "left_out": list(told["left_out"].items()),
            "max_rows": _MAX_ROWS,
        },
    )


def _requirements(verdict: PhotoVerdict) -> list[dict[str, Any]]:
    told = verdict.document
    rows = [
        {
            "name": "Surely shown, of what can be seen",
            "asked": f"at least {percent(told['required'])}",
            "found": f"{percent(told['surely'])}; possibly {percent(told['possibly'])}",
            "holds": _HOLDS[told["coverage_holds"]],
        }
    ]
    if told["pictures_asked"] is not None:
        rule = overlap_rule(verdict.site.scenario.sensor)
        rows.append(
            {
                "name": f"Ground in at least {told['pictures_asked']} pictures"
                + ("" if rule is None else f" ({rule})"),
                "asked": f"at least {percent(told['overlap_required'])}",
                "found": percent(told["overlap_fraction"]),
                "holds": "yes" if told["overlap_holds"] else "NO",
            }
        )
    searched = told["detection"]
    if searched is not None:
        rows.append(
            {
                "name": f"Probability of detection, mean of the area ({searched['title']})",
                "asked": "" if searched["asked"] is None else f"at least {percent(searched['asked'])}",
                "found": f"{percent(searched['pod'])}; best picture alone {percent(searched['pod_best_look'])}, every picture a "
                f"chance of its own {percent(searched['pod_every_picture'])}",
                "holds": {None: "not asked", True: "yes", False: "NO"}[searched["holds"]],
            }
        )
    return rows


def save_photo_report(verdict: PhotoVerdict, path: Path, user: User, *, force: bool) -> None:
    """Write the report.

    Raises:
        OutputError: it is there already and ``force`` was not said, or cannot be written.
    """
    refuse_to_replace(path, force=force)
    with user.progress("reporting"):
        text = render_photo_report(verdict)
    write_text(path, text)
    user.say(f"written: {path} ({len(text.encode()) / 1e6:.1f} MB)")


def refuse_to_replace(path: Path, *, force: bool) -> None:
    """See before pictures are judged that their report can be written.

    Raises:
        OutputError: it is there already and ``force`` was not said.
    """
    if path.exists() and not force:
        raise OutputError(f"{path}: would be overwritten; use --force, or another name")
