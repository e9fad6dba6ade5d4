"""Parts of ``make_figures.py``: the manifest and the records, the pages, and the probes."""
