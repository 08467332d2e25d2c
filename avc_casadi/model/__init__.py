"""Plain data and matrices: problem, device, hand, wall, plant, gains; they know no file."""
