"""Emulation of the firmware: an emulated core, a device on a bench, the core compiled for this host."""
