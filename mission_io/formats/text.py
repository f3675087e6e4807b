"""The bytes of a file as text, whatever program wrote it, and what had to be repaired for that."""

import codecs
from dataclasses import dataclass

from mission_io.errors import FormatError

_WIDE = ((codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))


@dataclass(frozen=True, slots=True)
class FileText:
    """The text of a file.

    Attributes:
        text: Without a byte order mark and with LF line ends.
        repairs: What was not as it should be, one line each.
    """

    text: str
    repairs: tuple[str, ...]


def text_from_bytes(data: bytes) -> FileText:
    """Decode a file: UTF-8, UTF-16 and UTF-32 with a byte order mark, and Latin-1 for what is not UTF-8.

    Raises:
        FormatError: zero bytes, so it is no text, or damaged UTF-16.
    """
    for mark, encoding in _WIDE:
        if data.startswith(mark):
            try:
                clean = clean_text(data.decode(encoding))
            except UnicodeDecodeError:
                raise FormatError(f"damaged {encoding.upper()} text", where="file", advice="save it as UTF-8") from None
            return FileText(clean.text, (f"decoded from {encoding.upper()}", *clean.repairs))
    if b"\0" in data:
        where = f"byte {data.index(0)}"
        raise FormatError("a zero byte: this is no text file", where=where, advice="choose a mission file")
    try:
        return clean_text(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        clean = clean_text(data.decode("latin-1"))
        return FileText(clean.text, (f"line {line}: not UTF-8, the file was read as Latin-1", *clean.repairs))


def clean_text(text: str) -> FileText:
    """The same text without a byte order mark and with LF line ends."""
    repairs: list[str] = []
    if text.startswith("\ufeff"):
        repairs.append("removed a byte order mark")
        text = text[1:]
    if "\r" in text:
        repairs.append("changed the line ends to LF")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return FileText(text, tuple(repairs))
