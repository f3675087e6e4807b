"""The judge: what was seen and whether it was safe, from the flown track. Knows nothing of planner or compiler."""
