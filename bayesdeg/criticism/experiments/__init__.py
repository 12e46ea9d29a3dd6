"""Proposals for the next experiments."""
