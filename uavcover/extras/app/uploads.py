"""Files of the user: kept under their names in the folder, photos in a folder of their run; and what photos show."""

import csv
import json
from pathlib import Path
from typing import Any

from anyio import to_thread
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from uavcover.errors import InputError
from uavcover.extras.app.workspace import OWN_FOLDER, PHOTOS, Workspace, free_name
from uavcover.report.cell_layers import REASON_WORDS

MOST_UPLOAD_BYTES = 256 << 20
PHOTO_KINDS = frozenset(
    {".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".mrk", ".txt", ".csv", ".json", ".bin", ".tlog", ".ulg"}
)
_SHOWN = (
    "verdict", "pictures", "counted", "coverage_of_coverable", "required", "overlap_fraction", "overlap_required", "gaps",
)  # fmt: skip
_MOST_LEFT_OUT = 200
MOST_PHOTO_BYTES = 16 << 30
"""Of all photos of a run."""


async def take_file(request: Request, workspace: Workspace) -> Response:
    """Keep a file under its name, or under a free one beside it; a photo of a run replaces the one of its name."""
    path = workspace.path(Path(request.path_params["name"]).name)
    run = request.query_params.get("photo_of", "")
    most = MOST_UPLOAD_BYTES
    if run:
        path, left = await to_thread.run_sync(_photo, workspace, run, path.name)
        most = min(most, left)
    too_large = f"{path.name}: the file is larger than the remaining {most >> 20} MiB; copy it into the folder instead"
    length = request.headers.get("content-length", "")
    if length.isdigit() and int(length) > most:
        return refusal(413, too_large)
    own = workspace.root / OWN_FOLDER
    own.mkdir(exist_ok=True)
    half, size = free_name(own, "upload", ".half"), 0
    try:
        with half.open("xb") as file:
            async for chunk in request.stream():
                size += len(chunk)
                if size > most:
                    return refusal(413, too_large)
                await to_thread.run_sync(file.write, chunk)
        if not run:
            path = free_name(path.parent, path.stem, path.suffix)
        half.rename(path)
    except OSError as error:
        return refusal(
            507, f"{path.name}: the file cannot be written ({error.strerror or error}); free some disk space"
        )
    finally:
        half.unlink(missing_ok=True)
    return JSONResponse({"name": workspace.name(path), "bytes": size})


def refusal(status: int, text: str, **more: Any) -> Response:
    """An answer that says what is wrong."""
    return JSONResponse({"error": text, **more}, status_code=status)


def _photo(workspace: Workspace, run: str, name: str) -> tuple[Path, int]:
    """Where a photo of a run is kept, and how many bytes there may still be."""
    folder = workspace.path(run)
    if not (folder / "plan.json").is_file():
        raise InputError(f"{folder.name}: this is not a run folder with a plan; plan first")
    if Path(name).suffix.lower() not in PHOTO_KINDS:
        raise InputError(f"{name}: is neither a photo (.jpg, .tif, .dng) nor a list of positions or log")
    photos = workspace.path(f"{run}/{PHOTOS}")
    photos.mkdir(exist_ok=True)
    path = workspace.path(f"{run}/{PHOTOS}/{name}")
    used = sum(each.stat().st_size for each in photos.iterdir() if each.is_file() and each.name != name)
    return path, max(0, MOST_PHOTO_BYTES - used)


def photo_document(folder: Path) -> dict[str, Any]:
    """Verdict, positions, footprints and gaps of a folder that ``judge-photos`` wrote.

    Raises:
        InputError: it is none.
    """
    try:
        verdict = json.loads((folder / "photos.json").read_text(encoding="utf-8"))
        shapes = [
            json.loads((folder / name).read_text(encoding="utf-8")) for name in ("footprints.geojson", "gaps.geojson")
        ]
        with (folder / "pictures.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{folder.name}: this is not a verdict of photos ({error}); create one with: uavcover judge-photos"
        ) from error
    placed = [row for row in rows if row.get("lon_deg") and row.get("lat_deg")]
    for gap in shapes[1]["features"]:
        gap["properties"]["reason"] = REASON_WORDS.get(gap["properties"].get("reason"), "planned photos are missing")
    left_out = [[row["name"], row["reason"]] for row in rows if row["counted"] != "yes"]
    return {
        **{key: verdict.get(key) for key in _SHOWN},
        "photos": [
            {"name": row["name"], "why": row["reason"], "place": [float(row["lon_deg"]), float(row["lat_deg"])]}
            for row in placed
        ],
        "footprints": shapes[0]["features"], "gapShapes": shapes[1]["features"], "leftOut": left_out[:_MOST_LEFT_OUT],
        "refly": (folder / "refly" / "plan.json").is_file(),
    }  # fmt: skip
