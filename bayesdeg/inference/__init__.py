"""Data, forward map and causes become a posterior."""
