"""A posterior becomes decisions."""
