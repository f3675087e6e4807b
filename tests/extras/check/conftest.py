"""Pages are opened in the browser of the report's tests."""

from tests.report.conftest import page

__all__ = ["page"]
