"""Text in the frames of a film: phase, fitting, time, distance and speeds of the belts."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from omnitrack_sim.record.trajectory import Trajectory

MODULE_COLOURS = ((243, 146, 28), (66, 146, 222), (30, 176, 122))
"""Modules 1, 2, 3 in text and bars, 8-bit RGB; brighter than on the robot, for a dark panel."""
FULL_BAR = 0.2
"""Belt speed that fills half of a bar, m/s."""
LEFT, WIDTH, HEIGHT = 18, 337, 224
"""Margin, width and height of the panel, pixels of a film with 720 lines."""
PANEL, TEXT, FAINT = (14, 18, 24, 190), (240, 243, 246), (160, 168, 178)
"""8-bit RGB, of panels with how far they cover what is behind."""


class Overlay:
    """Writes into frames of one size; letters scale with the height."""

    def __init__(self, width: int, height: int):
        self.scale = min(height / 720, width / 1280)
        self._large, self._small = font(self._px(26)), font(self._px(17))

    def _px(self, size: float) -> int:
        return max(1, round(size * self.scale))

    def write(
        self, frame: NDArray[np.uint8], trajectory: Trajectory, row: int, fitting: str = ""
    ) -> None:
        """Write the values of sample ``row`` into the lower left corner of ``frame`` (h, w, 3).

        ``fitting`` is the name of the part that the robot's centre is in.
        """
        px, bottom = self._px, len(frame) - self._px(LEFT)
        corner = frame[max(0, bottom - px(HEIGHT)) : bottom, px(LEFT) : px(LEFT) + px(WIDTH)]
        if 0 in corner.shape:
            return
        image = Image.fromarray(np.ascontiguousarray(corner))
        draw = ImageDraw.Draw(image, "RGBA")
        draw.rounded_rectangle((0, 0, px(336), image.height - 1), px(10), fill=PANEL)
        phase = trajectory.phases[int(trajectory["phase"][row])].replace("_", " ")
        draw.text((px(16), px(10)), phase, font=self._large, fill=TEXT)
        place = f"{trajectory.time[row]:5.2f} s     {1000 * trajectory['distance'][row]:5.0f} mm"
        place += f"     tilt {np.degrees(trajectory['tilt'][row]):.0f}°"
        where = f"in {fitting}" if fitting else ""
        if trajectory["gear"][row] < 0:
            where += ", tail first" if where else "tail first"
        draw.text((px(16), px(46)), self._cut(where, px(304)), font=self._small, fill=TEXT)
        draw.text((px(16), px(72)), place, font=self._small, fill=TEXT)
        draw.text((px(16), px(100)), "belt speed, mm/s", font=self._small, fill=FAINT)
        for module, speed in enumerate(trajectory["belt_speed"][row]):
            self._bar(draw, px(16), px(128 + 30 * module), module, float(speed))
        corner[:] = np.asarray(image)

    def _cut(self, text: str, width: int) -> str:
        """The text on one line, cut so that it is at most ``width`` pixels long."""
        text = " ".join(text.split())
        if self._small.getlength(text) <= width:
            return text
        while text and self._small.getlength(text + "\N{HORIZONTAL ELLIPSIS}") > width:
            text = text[:-1]
        return text + "\N{HORIZONTAL ELLIPSIS}"

    def _bar(
        self, draw: ImageDraw.ImageDraw, left: int, top: int, module: int, speed: float
    ) -> None:
        """Module number, bar from the middle (forward to the right) and figure."""
        px, colour = self._px, MODULE_COLOURS[module]
        draw.text((left, top), str(module + 1), font=self._small, fill=colour)
        draw.rectangle(
            (left + px(28), top + px(4), left + px(228), top + px(18)), fill=(255, 255, 255, 28)
        )
        middle = left + px(128)
        end = middle + round(px(100) * max(-1.0, min(1.0, speed / FULL_BAR)))
        draw.rectangle((min(middle, end), top + px(4), max(middle, end), top + px(18)), fill=colour)
        draw.line((middle, top + px(1), middle, top + px(21)), fill=FAINT, width=px(1.5))
        text = f"{1000 * speed:+.0f}".replace("-", "\u2212")
        draw.text((left + px(300), top), text, font=self._small, fill=TEXT, anchor="ra")


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """DejaVu Sans from matplotlib's data; Pillow's own letters if it is not there."""
    from importlib.util import find_spec

    spec = find_spec("matplotlib")
    path = (
        Path(spec.origin).parent / "mpl-data/fonts/ttf/DejaVuSans.ttf"
        if spec and spec.origin
        else None
    )
    return (
        ImageFont.truetype(str(path), size)
        if path and path.exists()
        else ImageFont.load_default(size)
    )
