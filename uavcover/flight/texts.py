"""Lines for the pilot as they were meant: long ones come in pieces of 50 letters, some with a tab at the end."""

from mission_io.messages import StatusText

_PIECE_LETTERS = 50


class TextAssembler:
    """Puts pieces of text together; a line of which a piece was lost is given as far as it came."""

    def __init__(self) -> None:
        self._open: StatusText | None = None
        self._next_chunk = 0

    def take(self, piece: StatusText) -> list[StatusText]:
        """The lines that are whole now, none to two: what was begun before ends when another line begins."""
        whole = []
        goes_on = self._open is not None and (piece.text_id, piece.chunk) == (self._open.text_id, self._next_chunk)
        if self._open is not None and not goes_on:
            whole.append(_tidy(self._open))
            self._open = None
        begun = "" if self._open is None else self._open.text
        line = StatusText(piece.severity, begun + piece.text, piece.text_id)
        if piece.text_id == 0 or len(piece.text) < _PIECE_LETTERS:
            self._open = None
            return [*whole, _tidy(line)]
        self._open, self._next_chunk = line, piece.chunk + 1
        return whole


def _tidy(line: StatusText) -> StatusText:
    """Without the tab by which PX4 marks a line that it tells as an event too."""
    return StatusText(line.severity, line.text.strip())
