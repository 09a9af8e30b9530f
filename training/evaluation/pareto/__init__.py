"""`evaluate pareto`: seconds against decibels."""
