"""Learned controllers: what they observe, what they decide, and what comes of it."""
