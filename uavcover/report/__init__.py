"""One HTML file that shows a run: what was asked, planned, flown and seen. Opens offline."""
