from mission_io.wire.messages import StatusText
from uavcover.flight.monitor import TextAssembler

LONG = "Arming denied: Resolve system health failures first, and then some more letters\t"


def lines(*pieces: StatusText) -> list[tuple[int, str]]:
    assembler = TextAssembler()
    return [(line.severity, line.text) for piece in pieces for line in assembler.take(piece)]


def test_a_short_line_is_a_line() -> None:
    assert lines(StatusText(6, "Takeoff detected\t")) == [(6, "Takeoff detected")]


def test_a_full_piece_of_a_line_without_a_number_is_a_line() -> None:
    assert lines(StatusText(4, "x" * 50)) == [(4, "x" * 50)]


def test_pieces_of_a_line_are_put_together() -> None:
    assert lines(StatusText(2, LONG[:50], 7, 0), StatusText(2, LONG[50:], 7, 1)) == [(2, LONG.strip())]


def test_a_line_of_exactly_two_pieces_ends_with_an_empty_one() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(2, "b" * 50, 7, 1), StatusText(2, "", 7, 2)) == [
        (2, "a" * 50 + "b" * 50)
    ]


def test_a_line_whose_end_was_lost_is_given_when_the_next_begins() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(5, "next")) == [(2, "a" * 50), (5, "next")]


def test_a_piece_that_does_not_fit_begins_a_line() -> None:
    assert lines(StatusText(2, "a" * 50, 7, 0), StatusText(2, "c", 7, 2)) == [(2, "a" * 50), (2, "c")]
