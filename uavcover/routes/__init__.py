"""Routes: cost, hard limits, and their compilation into missions."""
