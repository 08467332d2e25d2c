"""Utilities: array types, finite JSON, Ctrl-C, progress, checkpoints, processes, tables, units."""
