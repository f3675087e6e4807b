"""One vehicle: ready, armed, followed, recorded, brought home."""
