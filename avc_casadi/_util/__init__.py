"""What no library does: array types, finite JSON, Ctrl-C, progress, checkpoints, processes, tables, units."""
