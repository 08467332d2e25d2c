"""Linear stability of the frozen loop with a set of hands."""
