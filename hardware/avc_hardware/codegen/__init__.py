"""Code generation: float programs, generated C, exported couplings, boards and images; independent of the link."""
