"""Walks of several robots that together visit every cell of a grid, the longest one as short as can be."""
