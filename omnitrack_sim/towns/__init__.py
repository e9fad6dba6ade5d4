"""Reach of a robot in towns and plants: its passport, and the map."""
