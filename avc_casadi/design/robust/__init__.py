"""Wall behind an observer with state feedback, robust over hands and model mismatch of the device."""
