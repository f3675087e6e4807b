"""Ways to falsify the record of a flight, for ``tests/falsify.py`` and the tests."""
