"""Fast emulator of the forward map, with its own error."""
