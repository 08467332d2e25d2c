"""Claims on gains, one claim a module: levels L0 to L9, deployable, Z-width."""
