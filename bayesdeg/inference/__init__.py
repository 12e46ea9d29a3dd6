"""Posterior densities, and their modes, evidence and samples."""
