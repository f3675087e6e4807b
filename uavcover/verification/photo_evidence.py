"""Derive findings from real photos, or from their absence, for the verdict on a flight."""

from dataclasses import dataclass
from pathlib import Path

from uavcover.model.judgement import Finding, unproved
from uavcover.sensing.pictures import PictureCounts
from uavcover.verification.flown_coverage import FlownCoverage


@dataclass(frozen=True, slots=True)
class GivenEvidence:
    """Records of a flight that the user gave."""

    logs: tuple[Path, ...]  # flown tracks
    photos: tuple[Path, ...]  # photos, folders and lists of them
    system: int | None = None  # the vehicle of telemetry logs that have several; none: the only one


@dataclass(frozen=True, slots=True, eq=False)
class PictureEvidence:
    """Evidence from a flight's photos beside its track."""

    # coverage by cell, on the cells that results are judged on; none where the track alone tells it
    shown: FlownCoverage | None = None
    counts: PictureCounts | None = None  # number of photos that show each cell; none as for ``shown``
    # why they do not show enough, or nothing proves that they do, and what else is to be said of them
    findings: tuple[Finding, ...] = ()
    photos_required: bool = False  # whether a flight whose vehicle reported no photo is not proved


NOTHING_KNOWN = PictureEvidence()
NO_PICTURES = PictureEvidence(
    findings=(
        unproved(
            "photos",
            "no photo is reported: cells in view of the camera are counted, but no record shows that it took photos "
            "(--photos)",
        ),
    )
)
"""Evidence for a flight that was not planned here: no mission of ours triggered its camera."""
