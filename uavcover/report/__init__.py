"""The HTML report of a run: what was required, planned, flown and seen, in one file that opens offline."""
