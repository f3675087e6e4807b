"""Text from a vehicle or a file, safe to show: without control characters of terminals or hidden ones.

A STATUSTEXT with escape sequences clears the pilot's screen, a name with a bidirectional override reads as another name, and
a line feed forges a line of ours. Text from a link is cleaned as it is decoded; text from files where it leaves the program.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

_BREAKS = "\t\n\v\f\r\x1c-\x1f\x85\u2028\u2029"
_CONTROLS = "\x00-\x1f\x7f-\x9f\ud800-\udfff"
_INVISIBLE = (
    "\u00ad\u034f\u061c\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b-\u200f\u202a-\u202e\u2060-\u206f\u3164\ufeff\uffa0"
    "\ufff9-\ufffb\U0001d173-\U0001d17a\U000e0000-\U000e0fff"
)
"""Zero width or reordering: soft hyphens, joiners, marks and overrides of direction, fillers, annotations, tags."""

_HOSTILE = re.compile(f"([{_BREAKS}])|([{_CONTROLS}])|[{_INVISIBLE}]")


def counted(number: int, one: str, several: str = "") -> str:
    """A number and what it counts; ``several`` is what the words for one become, else an s is added.

    >>> counted(1, "photo"), counted(2, "photo"), counted(1, "photo was", "photos were")
    ('1 photo', '2 photos', '1 photo was')
    """
    return f"{number} {one if number == 1 else several or f'{one}s'}"


def plain_text(text: str) -> str:
    r"""The same text on one line, harmless wherever it is shown.

    Tabs and line breaks become spaces, other control characters (C0, C1 and halves of characters) become question marks, and
    characters that are invisible or reorder the text go. Text of ASCII keeps its length.

    >>> plain_text("\x1b[2JArmed\n\u202eready")
    '?[2JArmed ready'
    """
    if text.isascii() and text.isprintable():
        return text
    return _HOSTILE.sub(lambda found: " " if found[1] else "?" if found[2] else "", text)


def plain_lines(text: str) -> str:
    """The same for text of several lines, which keeps its line feeds and tabs."""
    return "\n".join("\t".join(map(plain_text, line.split("\t"))) for line in text.split("\n"))


def escaped_json(text: str) -> str:
    """The same JSON with escapes for characters that steer terminals; line feeds between values stay."""
    return text if text.isascii() else _HOSTILE.sub(_escape, text)


def _escape(found: re.Match[str]) -> str:
    character = found[0]
    return character if character in "\t\n\r" else json.dumps(character)[1:-1]


def plain_values(value: Any) -> Any:
    """A document of mappings and lists with all of its texts plain; what is neither is as it was."""
    match value:
        case str():
            return plain_text(value)
        case Mapping():
            return {plain_text(key) if isinstance(key, str) else key: plain_values(item) for key, item in value.items()}
        case list() | tuple():
            return [plain_values(item) for item in value]
    return value
