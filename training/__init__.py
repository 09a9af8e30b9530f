"""Trains BRDF encoders and neural temporal models, and measures them."""
