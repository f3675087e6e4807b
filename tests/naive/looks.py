"""Slow twin of :mod:`uavcover.sensing.photos`: one pair of photos after the other."""

import math


def looks_by_pairs(positions, axes, closer, ids):
    first, of_id, found = [], {}, []
    for k, position in enumerate(positions):
        members = [j for j in range(len(positions)) if ids[j] is not None and ids[j] == ids[k]]
        is_id = bool(members) and all(math.dist(positions[j], positions[members[0]]) <= 20.0 for j in members)
        if is_id and ids[k] in of_id:
            found.append(of_id[ids[k]])
            continue
        for number, leader in enumerate(first):
            offset = [a - b for a, b in zip(positions[leader], position, strict=True)]
            along = sum(a * b for a, b in zip(offset, axes[leader], strict=True))
            across = math.sqrt(max(0.0, sum(a * a for a in offset) - along**2))
            alike = sum(a * b for a, b in zip(axes[leader], axes[k], strict=True)) >= math.cos(math.radians(30.0))
            if across <= closer[k] and alike:
                found.append(number)
                break
        else:
            found.append(len(first))
            first.append(k)
        if is_id:
            of_id[ids[k]] = found[-1]
    return found
