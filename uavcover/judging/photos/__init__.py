"""Pictures that anybody took: where each was taken and where its camera looked, and what they show of an area."""
