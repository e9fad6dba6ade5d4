"""Kinds of fittings, one a module. A module put into this folder is found by itself."""
