"""Painting frames, in this process or in several."""
from __future__ import annotations
from collections.abc import Iterator, Sequence
def painted(result, times, size, camera, options, processes=1):
    from omnitrack_sim.film.stage import Stage
    with Stage(result, size, camera, **options) as stage:
        for t in times: yield stage.picture(t)
