"""Faults by lot: drawn, tried with the tests that run their lines, and counted."""
