"""What identifies a file."""

import hashlib
from pathlib import Path

_CHUNK = 1 << 20
SHOWN = 16
"""As many digits tell two builds apart."""


def sha256(path: Path) -> str:
    """The SHA-256 of a file's content, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()
