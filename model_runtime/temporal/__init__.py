"""Models of change: how a material's state at age 0 becomes its history."""
