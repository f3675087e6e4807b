"""The flight of one vehicle: ready, armed, followed, recorded, brought home."""
