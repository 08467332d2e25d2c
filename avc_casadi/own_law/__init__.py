"""Your own spring and damper: do they hold, by how much, where do they end, and what would help."""
