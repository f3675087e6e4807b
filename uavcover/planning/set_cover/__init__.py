"""Few places of a lattice from which much is seen: greedily, exactly, and as routes."""
