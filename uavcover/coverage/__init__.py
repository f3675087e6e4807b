"""What a sensor sees of an area from a route."""
