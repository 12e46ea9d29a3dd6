"""What is wrong, why, and what knowing it is worth."""
