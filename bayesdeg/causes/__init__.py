"""The catalogue of causes, one module per cause."""
