"""Both ways between our ask and tell and pymoo: its algorithms here, ours there."""
