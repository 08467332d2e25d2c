"""Diagnosis of a log of a loop that swings: the cause, the evidence, a remedy that was simulated."""
