"""What accuracy costs in time: methods and solvers, gain tables, grids of frequencies."""
