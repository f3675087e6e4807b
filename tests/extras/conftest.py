"""Commands of extras are tested as those of the core are."""

from tests.cli.conftest import cli, demo_run, flown, nowhere_run, planned

__all__ = ["cli", "demo_run", "flown", "nowhere_run", "planned"]
