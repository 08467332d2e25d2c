"""From one sample to the next: exact propagation, dry friction, other integrators."""
