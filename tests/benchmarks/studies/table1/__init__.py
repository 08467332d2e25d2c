"""The paper's experiment with simulated people: Table 1."""
