"""Devices of several axes: effective mass by pose and direction, gains by contact normal."""
