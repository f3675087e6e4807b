"""A package of a third party that extends uavcover through entry points alone."""
