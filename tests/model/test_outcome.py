from pathlib import Path

from uavcover.flight.orders import policy
from uavcover.model.track import Ending, FlightFailedError, FlightOutcome, Incident

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "flight.md"


def test_every_ending_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert [ending.key for ending in Ending if f"`{ending.key}`" not in page] == []


def test_an_outcome_is_numbers_and_names_for_programs() -> None:
    incident = Incident(Ending.LINK_LOST, "nothing heard", 12.5, 20.0)
    outcome = FlightOutcome(Ending.STUCK, 3, 250, 25.0, "a mock", (incident,), "in the air")
    assert FlightFailedError("stuck", outcome).details() == {
        "ending": "stuck",
        "waypoints_reached": 3,
        "samples": 250,
        "duration_s": 25.0,
        "simulated_by": "a mock",
        "vehicle_now": "in the air",
        "incidents": [{"kind": "link_lost", "text": "nothing heard", "begin_s": 12.5, "end_s": 20.0, "evidence": ()}],
    }


def test_the_policy_on_the_page_is_the_one_in_the_data() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for (breach, phase), rule in policy().items():
        [row] = [line for line in page.splitlines() if line.startswith(f"| `{breach.key}` | ") and rule.reason in line]
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert phase.value in cells[1].split(", ")
        assert cells[2:5] == [rule.simulated.value, rule.real.value, "yes" if rule.choice else "no"]
