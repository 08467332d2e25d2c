"""Studies that are too large for one script: what each measures and its figure."""
