"""The public face of mission_io: exactly these names; everything else may change."""

import pytest

import mission_io

NAMES = """
    ARDUPILOT ARDUPILOT_PLANE ARDUPILOT_ROVER LINK_PRESETS PX4
    Action Address AmbiguousVehicleError AsyncClient Autopilot Client Command CommandRefusedError Difference
    Fence FenceCircle FencePolygon FormatError Frame FramedPoint GeoPoint LatLon Link LinkError LinkPreset
    LinkStatistics ListChanged Mission MissionDiff MissionFile MissionIoError MissionItem MissionList MissionServer
    MissionType MisuseError Problem RallyPoints ReadBack SigningKey SpeedType Timing TransferCancelledError TransferError
    TransferInterrupted TransferSilentError UdpLink VehicleInfo VehicleSilentError WaitCancelledError
    ItemProgress Parameter VehicleParameters
    action_of apply_diff autopilot_for change_speed check_for_autopilot compare_items delay diff item_of items_of land
    link_preset look_ahead look_at mission_from_wire mission_list_of mission_type_of open_link read_file read_mission
    register_endpoint return_to_launch takeoff trigger_camera_every waypoint wire_items write_mission
"""


def test_the_exported_names() -> None:
    assert sorted(mission_io.__all__) == sorted(NAMES.split())


def test_the_places_name_the_same() -> None:
    assert sorted(mission_io._MODULE_OF) == sorted(NAMES.split())
    assert set(NAMES.split()) <= set(dir(mission_io))
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = mission_io.no_such_name


def test_every_exported_function_and_class_says_what_it_is() -> None:
    for name in NAMES.split():
        value = getattr(mission_io, name)
        assert not callable(value) or value.__doc__, name
