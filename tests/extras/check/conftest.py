"""Pages are opened in the browser of the report's tests."""

from tests.report.conftest import browser, page

__all__ = ["browser", "page"]
