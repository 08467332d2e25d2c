"""The methods side by side, frequency by frequency."""
