"""What is named, and what speaks for it."""
