"""Pictures at waypoints: what the vehicle's camera told of counts, and nothing else where it told of any."""

import numpy as np
import pytest

from mission_io.wire import messages as m
from tests.falsifying.honest_run import Base, Field, lines_over, make_site, save_lines
from tests.verification.flights import Flight, changed, reasons
from tests.verification.flights import make_site as nimble_site
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.sensor import SphereSensor
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.reported_photos import reports_photos
from uavcover.verification.unobserved import PlannedRoute
from uavcover.verification.verify import verify_track

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
