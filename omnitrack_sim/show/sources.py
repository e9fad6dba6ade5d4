"""Sources of pictures: runs, their folders, recordings, and playbacks of them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, TypeGuard

from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.recording_playback import RecordingPlayback
from omnitrack_sim.show.run_playback import CAMERAS, RunPlayback

Source = Playback | Result | Recording | str | os.PathLike[str]
"""Subject of pictures: a run or the folder of a saved one, a recording of any model or its file."""


def cameras_of(source: Source) -> tuple[str, ...]:
    """Return the names of a source's cameras; a run is not read for them."""
    if isinstance(source, Playback | Recording) or is_recording(source):
        return playback_of(source).cameras
    return CAMERAS


def is_recording(source: Any) -> TypeGuard[str | os.PathLike[str]]:
    """Return whether a source is the path of a saved recording."""
    return isinstance(source, str | os.PathLike) and Path(source).suffix == ".npz"


def playback_of(source: Source, *, coarse: bool = True) -> Playback:
    """Return the playback of a source, loaded where it is a folder or a file.

    Args:
        source: of which pictures are made; a playback is returned as it is.
        coarse: faces of the package's robot may be coarse, which is enough for films.

    Raises:
        InputError: a recording has no samples.
        OutputError: a folder is no run, or a file is no recording.
        TypeError: it is none of these.
    """
    if isinstance(source, Playback):
        return source
    if is_recording(source):
        source = Recording.load(source)  # type: ignore[arg-type]
    if isinstance(source, Recording):
        return RecordingPlayback(source)
    return RunPlayback(as_result(source), coarse)
