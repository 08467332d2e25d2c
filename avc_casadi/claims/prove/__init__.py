"""Proofs by interval arithmetic, loaded on demand."""
