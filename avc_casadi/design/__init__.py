"""Design methods by name: from a problem to gains."""
