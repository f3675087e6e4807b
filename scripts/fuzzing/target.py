"""What is tried: a reader with good files to start from, and the errors by which it may refuse a file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.text import text_from_bytes

LONGEST_ERROR = 500


def check(condition: bool, what: str) -> None:
    """An input that is read must survive."""
    if not condition:
        raise AssertionError(what)


@dataclass(frozen=True, slots=True)
class Target:
    """One reader.

    Attributes:
        read: reads an input, and checks what was read; raises.
        seeds: good inputs.
        refusals: errors that say that an input is none of its format.
        shown: what becomes of such an error's text before anybody sees it.
    """

    read: Callable[[bytes], None]
    seeds: Sequence[bytes]
    refusals: tuple[type[Exception], ...] = (FormatError,)
    shown: Callable[[str], str] = str

    def attempt(self, data: bytes) -> None:
        """One input; anything but a refusal in one short line gets out."""
        try:
            self.read(data)
        except self.refusals as error:
            line = self.shown(str(error))
            check("\n" not in line and len(line) < LONGEST_ERROR, "an error is one short line")


def of_text(read: Callable[[str], None], seeds: Sequence[str]) -> Target:
    """A target of text, which is decoded as files are."""
    return Target(lambda data: read(text_from_bytes(data).text), [seed.encode() for seed in seeds])


def of_latin(read: Callable[[str], None], seeds: Sequence[str]) -> Target:
    """A target of bytes, which it takes as Latin-1."""
    return Target(lambda data: read(data.decode("latin-1")), [seed.encode("latin-1") for seed in seeds])
