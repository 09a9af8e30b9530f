"""The live binding: a material that its shader ages, from coefficients, curves and one Age."""
