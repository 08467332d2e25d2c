"""Studies that are too large for one script: what each measures, its figure, and its command for `avc study`."""
