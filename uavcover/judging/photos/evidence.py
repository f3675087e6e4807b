"""What real pictures, or that there are none, mean for the verdict on a flight."""

from dataclasses import dataclass

from uavcover.judging.flown_coverage import FlownCoverage
from uavcover.model.judgement import Finding
from uavcover.sensing.pictures import PictureCounts


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
