"""Stiffness of a sagging Dragon Skin 10 cantilever from a motion-capture record."""
