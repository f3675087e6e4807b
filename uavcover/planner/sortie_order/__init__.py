"""The order in which a route of several sorties visits its stretches."""
