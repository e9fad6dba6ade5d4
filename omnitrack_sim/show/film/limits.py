"""What may be asked for in pictures and films."""

from __future__ import annotations

from omnitrack_sim.base.errors import Fault, InputError

CAMERAS = ("side", "follow", "onboard")
"""``side`` shows the pipes on the way, ``follow`` stays with the robot, ``onboard`` looks ahead."""
MOST_PIXELS = 7680
"""Longest side of a picture, pixels."""
MOST_FPS = 240
MOST_GIF_FPS = 50
"""Players show faster GIFs slower than they are."""
MOST_FILM = 5e11
"""Pixels of all frames of a film: six hours at 1280 x 720 and 25 frames a second, which take
most of a day to paint."""
MOST_PROCESSES = 64


def check_request(
    camera: str, width: int, height: int, fps: int = 1, format: str = "", processes: int = 1
) -> None:
    """Refuse what cannot be made, before any work.

    Raises:
        InputError: every fault.
    """
    faults = []
    if camera not in CAMERAS:
        faults = [Fault("camera", f"there is no camera {camera!r}", CAMERAS, given=camera)]
    sizes = {
        "width": (width, MOST_PIXELS),
        "height": (height, MOST_PIXELS),
        "fps": (fps, MOST_GIF_FPS if format == "gif" else MOST_FPS),
        "processes": (processes, MOST_PROCESSES),
    }
    faults += [
        Fault(name, f"is {value}; must be from 1 to {limit}")
        for name, (value, limit) in sizes.items()
        if not 1 <= value <= limit
    ]
    if faults:
        raise InputError(faults)


def check_frames(count: int, width: int, height: int) -> None:
    """Refuse more pictures than anybody can wait for.

    Raises:
        InputError: they have more than ``MOST_FILM`` pixels.
    """
    if count * width * height > MOST_FILM:
        most = int(MOST_FILM // (width * height))
        problem = f"are {count} of {width} x {height} pixels; at most {most} of this size"
        raise InputError(Fault("frames", problem))
