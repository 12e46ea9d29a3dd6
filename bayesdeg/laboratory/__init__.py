"""Virtual experiments: the finite element model as the truth, with an effect hidden in it."""
