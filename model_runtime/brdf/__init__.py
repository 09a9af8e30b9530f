"""Reflectance models, one file each; all are functions of half-angle coordinates."""
