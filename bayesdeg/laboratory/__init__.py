"""Virtual experiments: the finite element model as the truth, with a hidden effect."""
