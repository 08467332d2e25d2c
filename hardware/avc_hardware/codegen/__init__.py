"""From expressions to firmware: float programs, generated C, exported couplings, boards and images; knows no link."""
