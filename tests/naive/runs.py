"""Runs as plain sets."""


def squares_of(runs):
    """The squares of a rising row of first squares and first squares behind."""
    return {square for first, last in zip(runs[::2], runs[1::2], strict=True) for square in range(first, last)}


def changes(olds, news):
    """By how much the count of each square changes when sets give way to others; those that do not change are left out."""
    found = {}
    for by, sets in ((-1, olds), (1, news)):
        for squares in sets:
            for square in squares:
                found[square] = found.get(square, 0) + by
    return {square: by for square, by in found.items() if by}
