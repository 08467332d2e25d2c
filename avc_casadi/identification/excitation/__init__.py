"""Signals that identify a device, played within limits."""
