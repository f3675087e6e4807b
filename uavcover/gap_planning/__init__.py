"""A short route that sees just what an earlier flight has missed."""
