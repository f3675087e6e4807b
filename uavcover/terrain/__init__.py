"""The ground: read from elevation data or computed, as one surface in the local frame."""
