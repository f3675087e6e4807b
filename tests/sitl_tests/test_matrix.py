import pytest

from sitl_tests.capabilities import ALL
from sitl_tests.errors import MatrixError
from sitl_tests.matrix import cells_of, load_matrix

VEHICLES = {"one": {"simulator": "mock", "autopilot": "px4", "speed": 5}}


def test_the_matrix_and_the_capabilities_name_the_same():
    assert {cell.capability for cell in load_matrix()} == set(ALL)


def test_each_cell_has_a_name_of_its_own():
    names = [cell.name for cell in load_matrix()]
    assert len(set(names)) == len(names)


def test_what_a_vehicle_does_by_nature_stands_with_its_reason():
    usual = {cell.capability: cell.expected.outcome for cell in load_matrix() if not cell.expected.why}
    for cell in load_matrix():
        assert cell.expected.why or cell.expected.outcome == usual[cell.capability], cell.name


def test_a_cell_has_what_its_tables_say():
    document = {
        "vehicles": VEHICLES,
        "capabilities": {
            "fly": {
                "shows": "it flies",
                "otherwise": {"one": {"outcome": "falls", "why": "it is a stone"}},
                "parameters": {"px4": {"A": 1}, "ardupilot": {"B": 2}},
                "clients": ["native", "mavsdk"],
            }
        },
    }
    first, second = cells_of(document)
    assert first.name == "one-fly-native"
    assert second.client == "mavsdk"
    assert (first.expected.outcome, first.expected.why) == ("falls", "it is a stone")
    assert dict(first.parameters) == {"A": 1}
    assert first.vehicle.speed == 5.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"shows": "x", "expcted": "works"}, "capabilities.fly: 'expcted' is not one of"),
        ({"shows": "x", "otherwise": {"two": {}}}, "capabilities.fly.otherwise: 'two' is not one of one"),
        ({"shows": "x", "clients": ["qgc"]}, "capabilities.fly.clients: 'qgc' is not one of mavsdk, native"),
        ({"shows": "x", "parameters": {"inav": {}}}, "capabilities.fly.parameters: 'inav'"),
    ],
)
def test_an_unknown_word_is_named_with_its_place(change, said):
    with pytest.raises(MatrixError, match=said):
        list(cells_of({"vehicles": VEHICLES, "capabilities": {"fly": change}}))


def test_the_words_of_a_cell_must_be_said_in_its_events():
    document = {
        "vehicles": VEHICLES | {"two": VEHICLES["one"]},
        "capabilities": {
            "fly": {
                "shows": "it falls",
                "expected": "falls",
                "words": ["hits the ground", "16 m/s"],
                "otherwise": {"two": {"outcome": "flies", "why": "it is a bird"}},
            }
        },
    }
    stone, bird = cells_of(document)
    assert stone.expected.unsaid(["it hits the ground at 9 m/s"]) == ["16 m/s"]
    assert stone.expected.unsaid(["at 16 m/s", "it hits the ground"]) == []
    assert bird.expected.unsaid([]) == []
