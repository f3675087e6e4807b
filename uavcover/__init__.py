"""Plan UAV flights that see all of a rugged terrain, fly them, and prove what was seen."""
