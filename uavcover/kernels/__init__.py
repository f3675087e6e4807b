"""Compiled numeric kernels: arrays and scalars in, arrays out. Each has a slow, obvious twin in tests/naive."""
