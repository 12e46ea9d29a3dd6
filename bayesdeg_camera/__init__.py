"""Photographs and motion capture of actuators, turned into lines of points: an optional extra."""
