"""Photos at waypoints and by distance: those that the vehicle reported count, and nothing else where it reported any."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from mission_io.wire import messages as m
from tests.falsifying.honest_run import SURVEY, Base, Field, lines_over, make_site, save_lines
from tests.verification.flights import Flight, changed, reasons
from tests.verification.flights import make_site as nimble_site
from uavcover.mock.faults import parse_fault
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.sensor import SphereSensor
from uavcover.planner.close_gaps import plan_gap_mission
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.flown_coverage import PhotoEvidence
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.observations import reports_photos
from uavcover.verification.verify import FlownTrack, verify_flight, verify_track

SPHERES = 'kind = "sphere"\nrange_m = {range_m}\nsensing = "at-waypoints"\n'


class BlindOnce(MockVehicle):
    """Its camera fails to take its third picture."""

    def send(self, message: m.Message) -> None:
        if isinstance(message, m.CameraFeedback):
            if message.number == 3:
                return
            number = message.number - (message.number > 3)
            message = m.CameraFeedback(message.time_s, number, *(getattr(message, n) for n in message.__slots__[2:]))
        super().send(message)


def flown(folder, autopilot, range_m=130.0, **options):
    base = Base(name="spheres", sensor=SPHERES.format(range_m=range_m), lines=4, autopilot=autopilot)
    site = make_site(folder / "scenario", base)
    run = RunFolder(folder / "run")
    save_lines(run, site, base)
    Field(site=site, autopilot=autopilot, **options).fly(run)
    planned = read_planned(run)[1]
    return site, PlannedRoute(planned.route.waypoints_m, planned.coverage_fraction), read_track(run.file("track.csv"))


@pytest.mark.parametrize(
    ("autopilot", "loss"), [pytest.param("ardupilot", 0.0, marks=pytest.mark.long), ("px4", 0.0), ("ardupilot", 0.25)]
)
def test_every_planned_waypoint_has_its_picture_in_the_record(tmp_path, autopilot, loss):
    site, planned, track = flown(tmp_path, autopilot, loss=loss)
    count = len(planned.waypoints_m)
    assert reports_photos(track)
    # The vehicle's own count makes good for messages that were lost, but for those at the end.
    assert count - (3 if loss else 0) <= np.nanmax(track.pictures_taken) <= count
    promised = lines_over(site, lines=4, height_agl_m=80.0).chosen
    report = verify_track(site, judging_map(site), track, planned)
    assert loss or not report.missing_photos
    # Ground of a picture whose message was lost counts as not seen: where the vehicle was is not known.
    least = promised.metrics.coverage_fraction - (0.15 if loss else 0.02)
    assert least <= report.coverage_fraction <= promised.metrics.coverage_fraction + 0.02


def test_a_picture_that_was_not_taken_is_told_and_its_ground_not_seen(tmp_path):
    whole = flown(tmp_path / "whole", "ardupilot", range_m=95.0)
    site, planned, track = flown(tmp_path / "blind", "ardupilot", range_m=95.0, vehicle_class=BlindOnce)
    reports = [verify_track(site, judging_map(site), each, planned) for each in (whole[2], track)]
    count = len(planned.waypoints_m)
    assert np.nanmax(track.pictures_taken) == count - 1
    assert any(f"1 of {count} expected photos were not reported" in line for line in reports[1].findings)
    assert reports[1].coverage_fraction < reports[0].coverage_fraction


def test_of_a_record_that_tells_of_no_picture_the_waypoints_count():
    site = nimble_site(sensor=SphereSensor(kind="sphere", range_m=110.0))
    flight = Flight(site)
    as_before = flight.verify()
    assert not reports_photos(flight.track)
    assert as_before.photo_source == "predicted"
    # A vehicle that reported photos of an earlier flight has a camera that reports; of this flight it reported none.
    earlier = flight.verify(changed(flight.track, pictures_taken=np.full(len(flight.track), 7.0)))
    assert (earlier.photo_source, earlier.coverage_fraction, earlier.verdict) == ("reported", 0.0, "failed")
    one = np.full(len(flight.track), 7.0)
    one[len(one) // 2 :] = 8.0
    report = flight.verify(changed(flight.track, pictures_taken=one))
    assert 0.0 < report.coverage_fraction < as_before.coverage_fraction
    assert reasons(report)
    # A count that a restart sets back is no photo.
    back = np.where(np.arange(len(one)) < len(one) // 2, 7.0, 0.0)
    assert flight.verify(changed(flight.track, pictures_taken=back)).coverage_fraction == 0.0


REQUIRED = PhotoEvidence(photos_required=True)


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
