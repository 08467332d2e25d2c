"""Claims on gains, one claim a module: levels L0 to L5 and L7, deployable, Z-width."""
