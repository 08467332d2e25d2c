"""Gains for all frequencies, or for a scope wider than one, as one optimal-control problem."""
