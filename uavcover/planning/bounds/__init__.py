"""What no plan of a scenario can beat, proved."""
