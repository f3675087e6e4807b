"""Verification of flights from the flown track: coverage, safety, gaps. Never imports the planner."""
