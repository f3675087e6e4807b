"""What real pictures, or that there are none, mean for the verdict on a flight."""

from dataclasses import dataclass
from pathlib import Path

from uavcover.model.judgement import Finding, unproved
from uavcover.sensing.pictures import PictureCounts
from uavcover.verification.flown_coverage import FlownCoverage


@dataclass(frozen=True, slots=True)
class GivenEvidence:
    """What is left of a flight.

    Attributes:
        logs: flown tracks.
        photos: pictures, folders and lists of them.
        system: the vehicle of telemetry logs that have several; none: the only one.
    """

    logs: tuple[Path, ...]
    photos: tuple[Path, ...]
    system: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PictureEvidence:
    """What is known of a flight's pictures beside its track.

    Attributes:
        shown: coverage by cell, on the cells that results are judged on; none where the track alone tells it.
        counts: how many pictures show each cell; likewise.
        findings: why they do not show enough, or nothing proves that they do, and what else is to be said of them.
        photos_required: whether a flight whose vehicle reported no photo is not proved.
    """

    shown: FlownCoverage | None = None
    counts: PictureCounts | None = None
    findings: tuple[Finding, ...] = ()
    photos_required: bool = False


NOTHING_KNOWN = PictureEvidence()
NO_PICTURES = PictureEvidence(
    findings=(
        unproved(
            "photos",
            "nothing tells of a picture: what the camera would have seen is counted, and nobody knows whether it took any "
            "(--photos)",
        ),
    )
)
"""Of a flight that nobody planned here: no mission of ours triggered its camera."""
