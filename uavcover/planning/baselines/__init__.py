"""Constructed routes that a search begins with and is compared with."""
