"""From the worker's result to a material that ages."""
