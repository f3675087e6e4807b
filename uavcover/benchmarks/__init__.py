"""Benchmark problems for the optimizers: the CEC 2020 multimodal multi-objective suite with its reference sets."""
