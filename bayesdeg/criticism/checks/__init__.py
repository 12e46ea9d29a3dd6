"""Tests of misfit: its size, its place and its form."""
