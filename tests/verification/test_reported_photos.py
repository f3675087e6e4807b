"""Photos by distance: those that the vehicle reported count, and nothing else where it reported any."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from tests.falsifying.honest_run import SURVEY, Field, make_site, save_lines
from tests.verification.flights import changed
from uavcover.mock.faults import parse_fault
from uavcover.planner.close_gaps import plan_gap_mission
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.flown_coverage import PictureEvidence
from uavcover.verification.unobserved import PlannedRoute
from uavcover.verification.verify import FlownTrack, verify_flight

REQUIRED = PictureEvidence(photos_required=True)


@dataclasses.dataclass
class Survey:
    """A survey as it was flown."""

    site: object
    planned: PlannedRoute
    track: object
    outcome: object

    def judge(self, *tracks, **options):
        flown = [FlownTrack(track, self.planned) for track in tracks or [self.track]]
        return verify_flight(self.site, judging_map(self.site), flown, **options)

    def report(self, *tracks, **options):
        return self.judge(*tracks, **options).report


def fly(folder, autopilot="ardupilot", fault=None, **options):
    base = replace(SURVEY, autopilot=autopilot)
    site = make_site(folder / "scenario", base)
    run = RunFolder(folder / "run")
    save_lines(run, site, base)
    faults = {"faults": [parse_fault(fault)]} if fault else {}
    outcome = Field(site=site, autopilot=autopilot, options=faults, **options).fly(run)
    planned = read_planned(run)[1]
    route = PlannedRoute(planned.route.waypoints_m, planned.coverage_fraction)
    return Survey(site, route, read_track(run.file("track.csv")), outcome)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("whole"))


@pytest.mark.parametrize(("autopilot", "loss"), [("px4", 0.0), ("ardupilot", 0.25)])
def test_an_honest_survey_passes_with_the_photos_that_it_reported(tmp_path, autopilot, loss):
    survey = fly(tmp_path, autopilot, loss=loss)
    report = survey.report(evidence=REQUIRED)
    assert (report.verdict, report.photo_source) == ("passed", "reported")
    # The last messages of a route may be lost, and nothing later counts them: that is noted, and fails nothing.
    assert sum(stretch.expected for stretch in report.missing_photos) <= (2 if loss else 0)
    assert abs(report.pictures.taken - np.nanmax(survey.track.pictures_taken)) <= 1
    assert "PHOTOS_MISSING" not in {incident.kind.name for incident in survey.outcome.incidents}


def test_a_camera_that_stopped_is_an_alarm_and_proves_nothing_more(tmp_path):
    survey = fly(tmp_path, fault="camera-stops:4")
    report = survey.report()
    assert report.verdict != "passed"
    assert report.coverage_of_coverable < 0.1
    assert report.pictures.taken == 4
    (stretch,) = report.missing_photos
    assert stretch.expected > 170
    assert stretch.length_m > 1500.0
    (alarm,) = [i for i in survey.outcome.incidents if i.kind.name == "PHOTOS_MISSING"]
    assert "the camera has reported no photo for" in alarm.text


def test_the_gap_mission_flies_what_was_not_photographed(whole):
    verdict = whole.judge(changed(whole.track, pictures_taken=np.minimum(whole.track.pictures_taken, 150.0)))
    assert plan_gap_mission(whole.site, verdict).coverage_after > 0.97 > verdict.report.coverage_of_coverable


def test_one_photo_of_ten_fails(tmp_path):
    survey = fly(tmp_path, "px4", fault="camera-skips:10")
    report = survey.report()
    assert report.verdict == "failed"
    assert len(report.missing_photos) >= 15
    assert any(incident.kind.name == "PHOTOS_MISSING" for incident in survey.outcome.incidents)


def test_a_camera_that_reports_nothing_is_told_and_proves_nothing_where_photos_are_required(tmp_path):
    survey = fly(tmp_path, fault="camera-silent")
    report, required = survey.report(), survey.report(evidence=REQUIRED)
    assert (report.verdict, report.photo_source) == ("passed", "predicted")
    assert any("the vehicle reported no photo" in finding for finding in report.findings)
    assert required.verdict == "not proved"
    assert not survey.outcome.incidents


def test_half_of_the_photos_miss_the_overlap_and_are_gaps(whole):
    taken = np.floor(whole.track.pictures_taken / 3.0)
    report = whole.report(changed(whole.track, pictures_taken=taken))
    assert report.verdict == "failed"
    assert any(gap.reason == "too-few-looks" for gap in report.gaps)


def test_where_photos_were_taken_between_two_reports_is_known_only_if_none_is_missing(whole):
    """A count that rises by as many as are due fills a silence; one that rises by fewer says not which."""
    count = whole.track.pictures_taken
    silent = (count > 40) & (count < 80)
    lost = np.where(silent, 40.0, count)
    report = whole.report(changed(whole.track, pictures_taken=lost))
    assert (report.verdict, report.missing_photos) == ("passed", ())
    fewer = np.where(count >= 80, count - 20.0, lost)
    report = whole.report(changed(whole.track, pictures_taken=fewer))
    (stretch,) = report.missing_photos
    assert 18 <= stretch.expected <= 22
    assert report.verdict == "not proved"
    none = np.where(count >= 80, count - 39.0, lost)
    report = whole.report(changed(whole.track, pictures_taken=none))
    assert report.verdict == "failed"


def test_a_second_record_without_reports_proves_no_photo(whole):
    """The vehicle reports photos at some time, so a flight of it without any took none that is known."""
    dead = changed(whole.track, pictures_taken=np.full(len(whole.track), np.nan))
    early = whole.track.time_s < np.nanpercentile(whole.track.time_s, 30.0)
    part = whole.track.taken(early)
    later = changed(dead, time_s=dead.time_s + 4000.0)
    report = whole.report(part, later)
    assert report.photo_source == "reported"
    assert report.verdict == "not proved"
    assert report.coverage_of_coverable < 0.7


def test_two_records_of_one_flight_take_no_more_photos(whole):
    """Shifted by 0.45 m, or wandering by 1.6 m, a second log made 438 photos of 219."""
    alone = whole.report()
    east = whole.track.enu_m + np.array([0.45, 0.0, 0.0])
    geodetic = np.column_stack(whole.site.frame.geodetic_from_enu(east))
    for count in (whole.track.pictures_taken, np.full(len(east), np.nan)):
        both = whole.report(whole.track, changed(whole.track, enu_m=east, geodetic=geodetic, pictures_taken=count))
        assert both.pictures.taken == alone.pictures.taken
        assert both.pictures.overlap_fraction == pytest.approx(alone.pictures.overlap_fraction, abs=0.001)
