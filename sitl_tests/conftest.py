"""The marks ``long`` and ``slow`` of the matrix's cells, also where only this folder is collected (``tests/conftest.py``)."""

from tests.conftest import pytest_collection_modifyitems

__all__ = ["pytest_collection_modifyitems"]
