import pytest

from mission_io.errors import FormatError
from mission_io.formats import wpl
from mission_io.formats.text import text_from_bytes
from tests.mission_io.formats.samples import MISSION

TEXT = wpl.write_mission(MISSION)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32", "latin-1"])
def test_whatever_a_program_saved_is_read(encoding: str) -> None:
    file = text_from_bytes(("# Überflug\r\n" + TEXT).encode(encoding))
    assert wpl.read(file.text).mission() == MISSION
    assert file.text.startswith("# Überflug\n")
    wanted = {"utf-8-sig": "removed a byte order mark", "utf-16": "decoded from UTF-16", "utf-32": "decoded from UTF-32",
              "latin-1": "line 1: not UTF-8; the file was read as Latin-1", "utf-8": "changed the line ends to LF"}  # fmt: skip
    assert wanted[encoding] in file.repairs


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"QGC WPL 110\n\0", "byte 12: the file has a zero byte"),
        (b"\xff\xfe\x00", "invalid UTF-16"),
        (b"\xff\xfe\x00\x00\xff\xff\xff\xff", "invalid UTF-32"),
        (b"\xfe\xff\xd8\x00\x00A", "invalid UTF-16"),
    ],
)
def test_what_is_no_text_is_refused(data: bytes, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        text_from_bytes(data)


def test_a_text_file_in_order_needs_no_repair() -> None:
    assert text_from_bytes(TEXT.encode()).repairs == ()
