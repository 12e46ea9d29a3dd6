"""Diagnostics of posteriors: convergence, polynomial order, prior sensitivity."""
