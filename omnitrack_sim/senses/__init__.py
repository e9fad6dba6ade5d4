"""Sensors of a robot that drives by itself: encoders, inertial unit, cameras, and their noise."""
