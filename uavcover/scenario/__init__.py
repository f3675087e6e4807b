"""The scenario on its ground: what is asked, and where."""
