"""Optima of (11)-(12) to 50 digits, by other means than the methods that are held against them; needs mpmath."""
