"""Robots that drive by their own sensors, counted."""
