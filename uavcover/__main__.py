"""``python -m uavcover``: the same as the ``uavcover`` command."""

from uavcover.cli.main import run

if __name__ == "__main__":
    run()
