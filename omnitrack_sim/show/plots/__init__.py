"""Figures of runs, networks and trials: ``plot_WHAT(what, *, path=None, format=None)`` returns a
figure of matplotlib and writes it where there is a path; those with one chart take ``ax`` and draw
there.
"""
