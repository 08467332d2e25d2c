"""Plain data and matrices: problem, device, hand, wall, plant, gains; independent of files."""
