"""Utilities: array types, finite JSON, Ctrl-C, progress, processes, tables, units."""
