"""Adapters in both directions: pymoo's algorithms behind our ask and tell, and ours in pymoo."""
