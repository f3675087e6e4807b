"""The vendored files are those of their packages, unchanged."""

import hashlib
from pathlib import Path

import pytest

from uavcover.extras.app import server

SHA256 = {
    "maplibre-gl/maplibre-gl-worker.mjs": "73d7a024a4efe1a46e49db193e18cfe33271e3ecc652ec7542c281a4ef5f0f04",
    "maplibre-gl/maplibre-gl.css": "a90798a1953017790e590f7e1bd35ff103a8a4263972cb47290b78adf86f8c20",
    "maplibre-gl/maplibre-gl.mjs": "e02cb08c572fd0950a75343cd558099c2a1dbbaf67f26b0c96f115431962d1ae",
    "terra-draw/terra-draw-maplibre-gl-adapter.module.js": "84979783dd68d8a6567b8ad65e0720d4b06c502e766e9405ee7119448f537e0b",
    "terra-draw/terra-draw.module.js": "04a7c677c85268d508740c00bd7678d278698e3796a46d90a20d6fae6e6a3df0",
}


@pytest.mark.parametrize("name", SHA256)
def test_a_file_is_that_of_its_package(name: str) -> None:
    assert hashlib.sha256((server.VENDOR / name).read_bytes()).hexdigest() == SHA256[name]


def test_there_is_no_other() -> None:
    found = {
        path.relative_to(server.VENDOR).as_posix()
        for path in Path(server.VENDOR).rglob("*")
        if path.suffix in (".js", ".mjs", ".css")
    }
    assert found == set(SHA256)
