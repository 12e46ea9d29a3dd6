"""The order of the work, and what it writes."""
