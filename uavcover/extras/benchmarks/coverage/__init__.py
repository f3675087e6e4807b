"""Planners and baselines compared on the bundled scenarios, at equal processor time and at equal evaluations."""
