"""Diagnosis of a loop that oscillates."""
