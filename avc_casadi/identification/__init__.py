"""From logs to a device file."""
