"""Slow, obvious twins of the kernels: what the fast ones are compared with."""
