"""The list of a folder by MAVLink FTP: page after page, until the vehicle reports its end."""

from dataclasses import dataclass
from enum import Enum

from mission_io.errors import FormatError
from mission_io.protocol.ftp import FtpError, FtpMessage, FtpOperation, path_bytes
from mission_io.protocol.ftp_window import FtpQuestion, FtpWaits
from mission_io.protocol.tuning import FILES


@dataclass(frozen=True, slots=True)
class FtpEntry:
    """A file or a folder in a folder."""

    name: str  # without the folder
    size_bytes: int | None  # of a file; None for a folder, and where the vehicle says none
    is_folder: bool  # whether it is a folder


class FtpListingState(Enum):
    """Where a listing is."""

    ASKING = "asking"
    DONE = "done"
    REFUSED = "refused"
    SILENT = "silent"


class FtpListing:
    """One folder; sans-IO.

    Args:
        path: The folder.
        now: The present time in seconds.
        silent_s: Silence after which it gives up.
    """

    def __init__(self, path: str, *, now: float, silent_s: float = 30.0) -> None:
        self.path, self.silent_s = path, silent_s
        self.state, self.why = FtpListingState.ASKING, ""
        self._path = path_bytes(path if path == "/" else path.rstrip("/"))
        self._entries: dict[str, FtpEntry] = {}
        self._offset, self._heard_at_s = 0, now
        # a server answers a repeated number as it did before, and an earlier transfer may have ended with any.
        self._seq = round(now * 1000.0) % 65536
        self._waits = FtpWaits()
        self._question = self._next_question()

    @property
    def finished(self) -> bool:
        """Whether it has ended, well or not."""
        return self.state is not FtpListingState.ASKING

    @property
    def entries(self) -> list[FtpEntry]:
        """Known entries of the folder: folders first, by name."""
        return sorted(self._entries.values(), key=lambda entry: (not entry.is_folder, entry.name))

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """Messages to send at ``now``."""
        if self.finished:
            return []
        if now >= self._heard_at_s + self.silent_s:
            self.state, self.why = FtpListingState.SILENT, f"no answer for {self.silent_s:g} s"
            return []
        return self._question.messages_to_send(now)

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it has ended."""
        return None if self.finished else min(self._heard_at_s + self.silent_s, self._question.next_timer)

    def receive(self, payload: bytes, now: float) -> None:
        """Take the payload of an answer."""
        answer = FtpMessage.answer(payload)
        if self.finished or answer is None:
            return
        if not self._question.is_answered_by(answer, now):
            return
        self._heard_at_s = now
        if answer.error == FtpError.END_OF_FILE:
            self.state = FtpListingState.DONE
        elif answer.error is not None:
            self._refuse(f"LIST_DIRECTORY: {answer.error_text}")
        else:
            self._take_page(answer.data)

    def _next_question(self) -> FtpQuestion:
        self._seq = (self._seq + 1) % 65536
        request = FtpMessage(self._seq, FtpOperation.LIST_DIRECTORY, offset=self._offset, data=self._path)
        return FtpQuestion(request, self._waits)

    def _refuse(self, why: str) -> None:
        self.state, self.why = FtpListingState.REFUSED, why

    def _take_page(self, data: bytes) -> None:
        lines = [line for line in data.split(b"\0") if line]
        if not lines:
            self.state = FtpListingState.DONE
            return
        self._offset += len(lines)
        try:
            page = [_entry(line) for line in lines if line[:1] != b"S" and line not in (b"D.", b"D..")]  # S: skipped
        except FormatError as error:
            self._refuse(str(error))
            return
        again = next((entry.name for entry in page if entry.name in self._entries), None)
        self._entries |= {entry.name: entry for entry in page}
        if again is not None:
            self._refuse(f"the vehicle lists {again!r} repeatedly, or the folder is changing")
        elif self._offset > FILES.most_entries:
            self._refuse(f"the vehicle lists more than {FILES.most_entries} entries")
        else:
            self._question = self._next_question()


def _entry(line: bytes) -> FtpEntry:
    """From ``Dname`` or ``Fname<tab>size``."""
    text = line.decode("utf-8", errors="backslashreplace")
    kind, (name, _, size) = text[0], text[1:].partition("\t")
    if kind not in "DF" or not name or not ((size.isascii() and size.isdigit()) or not size):
        raise FormatError(f"{text!r} is not an entry of a folder")
    return FtpEntry(name, int(size) if size and kind == "F" else None, kind == "D")
