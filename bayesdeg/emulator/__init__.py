"""The forward map, fast, with its own error."""
