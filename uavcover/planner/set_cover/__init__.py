"""Set covers on a lattice of places: greedy, exact, and turned into routes."""
