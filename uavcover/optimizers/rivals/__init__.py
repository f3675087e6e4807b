"""Optimizers that the paper's method is compared with."""
