"""Where the firmware runs without a board: an emulated core, a device on a bench, the core compiled for this host."""
