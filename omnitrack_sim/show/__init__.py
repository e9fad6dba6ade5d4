"""Figures, films, replay pages and the window, all from saved trajectories."""
