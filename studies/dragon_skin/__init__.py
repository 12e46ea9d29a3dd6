"""What a motion-capture record of a sagging Dragon Skin 10 cantilever says of its stiffness."""
