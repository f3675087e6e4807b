"""The benchmarks behind ``uavcover bench``: planners, optimizers, the paper's simulation, and transfers over bad links."""
