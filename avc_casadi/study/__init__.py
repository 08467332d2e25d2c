"""Studies over methods, guarantees, estimators and simulated people."""
