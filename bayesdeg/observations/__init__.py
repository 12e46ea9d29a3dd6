"""What was measured: one module for each kind of data."""
