"""Hostile texts, and what is hostile in a text: for tests that attack whatever is shown, logged or written."""

import random
import re

HOSTILE = (
    "\x1b[2J\x1b[H",  # clears the screen
    "\x1b]0;PWNED\x07",  # sets the title
    "\x1b]52;c;cm0gLXJm\x1b\\",  # writes the clipboard
    "\x9b31m\x9d0;t\x9c",  # the same by C1
    "\x1bP+q\x1b\\\x1bc",
    "ok\rerror: fake",
    "line\nwarning: forged",
    "a\x85b\u2028c\u2029d",
    "safe\u202etxt.exe\u202c",
    "\u2066iso\u2069\u200e\u200f\u061c",
    "zero\u200bwidth\u200c\u200d\ufeff\u2060\u00ad",
    "\x00\x07\x08\x7f\x0e",
    "tag\U000e0041\U000e007f",
)

CONTROL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff\U000e0000-\U000e0fff]"
)


def control_characters(text: str) -> set[str]:
    """The control characters of a text."""
    return set(CONTROL.findall(text))


def hostile_text(rng: random.Random) -> str:
    """Hostile pieces between letters."""
    return "".join(f"n{rng.choice(HOSTILE)}m" for _ in range(rng.randint(1, 3)))


def hostile_bytes(rng: random.Random, size: int) -> bytes:
    """Any bytes without zeros, at most ``size``."""
    data = b"".join(
        rng.choice((b"x", rng.choice(HOSTILE).encode(errors="ignore"), rng.randbytes(2))) for _ in range(30)
    )
    return data.replace(b"\0", b"")[:size]
