"""Kinds of fittings. A module put into this folder is found by itself."""
