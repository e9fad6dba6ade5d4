"""Figures of runs, networks and trials, by functions that return and may write one.

``plot_WHAT(what, *, path=None, format=None)`` returns a figure of matplotlib and writes it where
there is a path; those with one chart take ``ax`` and draw there.
"""
