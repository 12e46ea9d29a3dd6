"""Readings become quantities."""
