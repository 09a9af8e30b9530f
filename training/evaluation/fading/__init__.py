"""`evaluate fading`: a dye by the light it has had."""
