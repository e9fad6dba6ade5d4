"""Pictures painted in this process, or in several, in order and the same to the bit."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.workers import LocalPool

if TYPE_CHECKING:
    from omnitrack_sim.results.result import Result
    from omnitrack_sim.show.film.encoding import Image
    from omnitrack_sim.show.film.stage import Stage

_AHEAD = 3
"""Pictures for each process that may be under way."""
_stages: list[Stage] = []  # of a worker: the one that it paints, once it has been asked to


def painted(
    result: Result,
    times: Sequence[float],
    size: tuple[int, int],
    camera: str,
    options: Mapping[str, Any],
    processes: int = 1,
) -> Iterator[Image]:
    """The pictures (height, width, 3) of a run at ``times`` s.

    Args:
        result: the run.
        times: s.
        size: width and height, pixels.
        camera: one of ``CAMERAS``.
        options: of ``Stage``.
        processes: that paint.

    Raises:
        RenderError: no offscreen OpenGL, or a process died.
    """
    if processes == 1 or len(times) < 2:
        from omnitrack_sim.show.film.stage import Stage

        with Stage(result, size, camera, **options) as stage:
            yield from map(stage.picture, times)
        return
    try:
        yield from _spread(result, times, size, camera, options, min(processes, len(times)))
    except BrokenProcessPool:
        raise RenderError("a process that painted died; ask for fewer processes") from None


def _spread(
    result: Result,
    times: Sequence[float],
    size: tuple[int, int],
    camera: str,
    options: Mapping[str, Any],
    processes: int,
) -> Iterator[Image]:
    """As ``painted``, by worker processes."""
    with TemporaryDirectory(prefix="omnitrack-film-") as folder, LocalPool(processes) as pool:
        asked = Path(folder) / "asked"
        # Tables of fittings are classes made while files are read, which cannot be pickled.
        scenario = result.scenario.model_dump(mode="json", exclude_none=True)
        rest = replace(result, scenario=None)  # type: ignore[arg-type]
        asked.write_bytes(pickle.dumps((scenario, rest, size, camera, dict(options))))
        under_way: deque[Future[Image]] = deque()
        try:
            for time in times:
                if len(under_way) == _AHEAD * processes:
                    yield under_way.popleft().result()
                under_way.append(pool.submit(_paint, asked, time))
            while under_way:
                yield under_way.popleft().result()
        except BaseException:  # as well where no further picture is wanted
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _paint(asked: Path, time: float) -> Image:
    """One picture, in a worker, which keeps its stage."""
    if not _stages:
        # Software OpenGL takes a thread for each processor, and so does each of these processes.
        os.environ.setdefault("LP_NUM_THREADS", "1")
        from omnitrack_sim.scenario import Scenario
        from omnitrack_sim.show.film.stage import Stage

        scenario, rest, size, camera, options = pickle.loads(asked.read_bytes())
        result = replace(rest, scenario=Scenario.model_validate(scenario))
        _stages.append(Stage(result, size, camera, **options))
    return _stages[0].picture(time)
