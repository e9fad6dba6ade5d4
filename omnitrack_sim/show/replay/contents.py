"""Contents of the replay page as tables of numbers, packed into one short text.

They are curves, phases, events, map and pictures over time, the robot, its motion, the pipes and
the cameras.
"""

from __future__ import annotations

import base64
import io
import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Part
from omnitrack_sim.record.display import FORCES, Colour, ForceArrow
from omnitrack_sim.results.pictures import Pictures
from omnitrack_sim.show.film.overlay import BESIDE, levels, palette
from omnitrack_sim.show.film.shots import DISTANCE, view_directions
from omnitrack_sim.show.legend import merged
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.plots.run_figures import shade_of
from omnitrack_sim.show.projection import clearest
from omnitrack_sim.show.surfaces import MARK, Surface, geoms_surface, opened_pipe, rings
from omnitrack_sim.walls.meshes import THICKNESS, cut_normal
from omnitrack_sim.walls.pipe_looks import (
    FIELD_OF_VIEW,
    PIPE_LOOK,
    follow_direction,
    view_direction,
)

STEPS = 65534
"""Steps between the lowest and the highest number of a column that is rounded to its own range."""


class Pack:
    """Tables of numbers in one short text, which the page unpacks (page/unpack.js).

    Tables are added one by one; each is told by a value that JSON can hold.

    A table is a list of columns of whole numbers. Of each column the differences from row to row
    are kept, as whole numbers without a sign (0, -1, 1, -2 ... as 0, 1, 2, 3 ...), first the low
    bytes of all rows, then the next ones. Neighbouring rows differ little, so most bytes are small
    and alike, and deflate makes little of them.
    """

    def __init__(self) -> None:
        self._data = bytearray()

    def whole(self, values: ArrayLike) -> dict[str, Any]:
        """Add whole numbers (n,) or (n, k) of at most 47 bits."""
        table = np.asarray(values, np.int64)
        table = table.reshape(len(table), -1)
        # The sign goes into the lowest bit, so that small changes of either sign are small numbers.
        change = np.diff(table, axis=0, prepend=0)
        coded = np.where(change < 0, -2 * change - 1, 2 * change).T  # (k, n)
        width = max(1, (int(coded.max(initial=0)).bit_length() + 7) // 8)
        place = {"at": len(self._data), "rows": len(table), "columns": table.shape[1]}
        for column in coded:
            octets = np.ascontiguousarray(column, "<i8").view(np.uint8).reshape(-1, 8)
            self._data += octets[:, :width].T.tobytes()
        return place | {"bytes": width}

    def steps(self, values: ArrayLike, step: float) -> dict[str, Any]:
        """Add finite numbers (n,) or (n, k), each rounded to whole ``step``s."""
        return self.whole(np.rint(np.asarray(values, float) / step)) | {"step": step}

    def ranged(self, values: ArrayLike) -> dict[str, Any]:
        """Add numbers (n, ...), each column rounded to 1 / ``STEPS`` of its range.

        Non-finite ones are gaps.
        """
        table = np.asarray(values, float).reshape(len(np.asarray(values)), -1)
        there = np.isfinite(table)
        least = np.where(there, table, np.inf).min(axis=0, initial=np.inf)
        most = np.where(there, table, -np.inf).max(axis=0, initial=-np.inf)
        low, high = (np.where(np.isfinite(bound), bound, 0.0) for bound in (least, most))
        step = np.where(high > low, (high - low) / STEPS, 1.0)
        rounded = np.rint(np.where(there, table - low, 0.0) / step)
        place = self.whole(np.where(there, rounded, STEPS + 1))
        return place | {"low": low.tolist(), "steps": step.tolist(), "gap": STEPS + 1}

    def text(self) -> str:
        """All tables, deflated, in base64."""
        # At the highest level the page is one in a hundred smaller, and deflating takes six times
        # as long.
        return base64.b64encode(zlib.compress(bytes(self._data), 6)).decode("ascii")


def rounded(values: ArrayLike, digits: int) -> Any:
    """Return numbers as lists for JSON, rounded to ``digits`` after the point."""
    return (np.round(np.asarray(values, float), digits) + 0.0).tolist()  # 0.0, not -0.0


PICTURE_PERIOD = 0.5
"""Time between two pictures of a page, s."""
MAX_PICTURES = 600
"""Pictures of a page; those of a long run are farther apart."""
TILE, TILES_ACROSS = 48, 25
"""Largest side of a picture's tile, pixels, and tiles beside each other."""


def run_table(playback: Playback, pack: Pack, shapes: Shapes) -> dict[str, Any]:
    """Return a run as the page reads it."""
    return {
        "heading": playback.heading,
        "time": pack.steps(playback.time, TIME_STEP),
        "robot": robot_table(playback, pack, shapes),
        "curves": {name: pack.ranged(curve.values) for name, curve in playback.curves.items()},
        "arrows": [
            {"kind": arrow.kind, "at": pack.ranged(arrow.point), "force": pack.ranged(arrow.force)}
            for arrow in playback.arrows
        ],
        "phases": phases_table(playback),
        "fittings": fittings_table(playback),
        "events": [{"time": time, "text": text} for time, text in playback.events],
        "notes": playback.notes,
    }


def panel_table(playback: Playback, name: str) -> dict[str, Any]:
    """Return the plot of a curve; columns of what never acts have no name and no line."""
    curve, table = playback.curves[name], {"channel": name, "first": name in playback.first_plots}
    if curve.names:
        names: list[str | None] = [None] * len(curve.names)
        paints = list(names)
        for column, word, colour in playback.lines(name):
            names[column], paints[column] = word, css(colour or (0.0, 0.0, 0.0))
        table |= {"names": names, "colours": paints, "told": curve.display.each in playback.legends}
    return table | asdict(curve.display)


def css(colour: Colour) -> str:
    """Return a colour as style sheets have it."""
    return f"rgb({','.join(str(round(255 * part)) for part in colour)})"


def legends_table(playback: Playback) -> list[dict[str, Any]]:
    """Return the legends of the robot's parts: heading, and short name, name, colour and number.

    Numbers are those that stand on the bodies.
    """
    numbers = {badge.body: badge.text for badge in playback.badges}
    return [
        {
            "heading": legend.heading,
            "rows": [
                [short, name, css(colour), numbers.get(name, "")]
                for short, name, colour in legend.rows
            ],
        }
        for legend in merged(playback.legends.values())
    ]


def phases_table(playback: Playback) -> list[dict[str, Any]]:
    """Return the phases in order, with times in s and the colours of the summary figure."""
    return [
        {
            "name": phase.name.replace("_", " "),
            "start": phase.start,
            "end": phase.end,
            "colour": shade_of(phase.code),
        }
        for phase in playback.phases
    ]


def fittings_table(playback: Playback) -> list[dict[str, Any]]:
    """Return the fittings that the robot's centre was in, in order, with times in s."""
    leg = playback.leg
    return [
        {
            "name": span.part.name,
            "manoeuvre": span.words,
            "colour": span.colour,
            "leg": None if leg is None else int(leg[span.first]) + 1,
            "tail": bool(playback.backward[span.first]),
            "start": float(playback.time[span.first]),
            "end": float(playback.time[span.last]),
        }
        for span in playback.passages
    ]


def force_kinds(arrows: Sequence[ForceArrow], scale: float) -> dict[str, Any]:
    """Return the kinds of the arrows of forces, each with the length of its arrows, m/N.

    Nearly the largest arrow is about half a bore long.
    """
    kinds = {}
    for kind in dict.fromkeys(arrow.kind for arrow in arrows):
        words, colour, ends = FORCES[kind]
        of_kind = [arrow.force for arrow in arrows if arrow.kind == kind]
        sizes = np.linalg.norm(np.concatenate(of_kind), axis=-1)
        sizes = sizes[np.isfinite(sizes)]
        large = float(np.percentile(sizes, 98)) if len(sizes) else 0.0
        length = 1e-3
        if large > 0:
            value = 0.08 * scale / large
            power = 10.0 ** math.floor(math.log10(value))
            # The largest of 1, 2 or 5 times a power of ten up to it.
            length = max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9))
        kinds[kind] = {"words": words, "colour": colour, "ends": ends, "scale": length}
    return kinds


def map_table(playback: Playback, pack: Pack) -> dict[str, Any] | None:
    """Return the map: pipes, goals and plates, and where the robot goes; None without a map.

    Pieces of the pipes' axes come from the farthest to the nearest. All lie in m to the right and
    up, each with the sample from which on it is on the map.
    """
    landmarks = playback.landmarks
    if landmarks is None:
        return None
    network, end = playback.network, len(playback.time)
    parts, view = network.parts, clearest(network)
    pieces = view.segments(parts)

    def shown(key: str, shapes: Iterable[Array], first: Iterable[int]) -> list[dict[str, Any]]:
        """Return the shapes that ever are on the map, each with the sample from which on."""
        rows = zip(shapes, map(int, first), strict=True)
        return [{key: rounded(shape, 4), "from": row} for shape, row in rows if row < end]

    return {
        "beside": BESIDE,
        "ahead": pack.steps(playback.ahead, 1e-4),
        "backward": pack.whole(playback.backward.astype(int)),
        "view": rounded(view.axes[:, :2].T, 7),
        "pieces": [
            {"radius": round(parts[number].fitting.radius, 4)} | piece
            for number, ends in pieces
            for piece in shown("ends", [ends], [landmarks.parts[number]])
        ],
        "goals": shown("point", view.flat(landmarks.goal_points), landmarks.goals),
        "plates": shown("rim", map(view.flat, landmarks.plate_rims), landmarks.plates),
    }


def pictures_table(playback: Playback) -> dict[str, Any] | None:
    """Return the pictures of the camera at the leading end; None where there are none.

    They are a PNG of tiles row by row, with the time of each, s.
    """
    pictures = playback.album
    chosen = [] if pictures is None else _leading(pictures, playback)
    if pictures is None or not chosen:
        return None
    side, rows = min(TILE, pictures.size), -(-len(chosen) // TILES_ACROSS)
    # Of a picture with more pixels, the tile has those nearest to the middles of its own.
    places = ((np.arange(side) + 0.5) * pictures.size / side).astype(np.intp)
    sheet = np.zeros((rows * side, min(TILES_ACROSS, len(chosen)) * side), np.uint8)
    for number, index in enumerate(chosen):
        top, left = side * (number // TILES_ACROSS), side * (number % TILES_ACROSS)
        tile = levels(pictures[index][np.ix_(places, places)], pictures.unit)
        sheet[top : top + side, left : left + side] = tile
    image, buffer = Image.fromarray(sheet, "P"), io.BytesIO()
    image.putpalette(palette(pictures.unit).tobytes())
    image.save(buffer, "PNG", optimize=True)
    return {
        "png": base64.b64encode(buffer.getvalue()).decode(),
        "side": side,
        "columns": TILES_ACROSS,
        "time": [round(float(pictures.time[index]), 6) for index in chosen],
    }


def _leading(pictures: Pictures, playback: Playback) -> list[int]:
    """Return the indices of the pictures ahead, the first one of each period."""
    rows = np.clip(np.searchsorted(playback.time, pictures.time), 0, len(playback.time) - 1)
    ahead = np.flatnonzero((pictures.end < 0) == playback.backward[rows])
    period = max(PICTURE_PERIOD, float(np.ptp(pictures.time)) / (MAX_PICTURES - 1))
    slot = np.floor(pictures.time[ahead] / period + 1e-6)
    return ahead[np.diff(slot, prepend=-1.0) > 0].tolist()


LAMP_AHEAD = 0.004
"""Distance of the lamp in front of the onboard camera, m."""
SECTIONS = 96
"""Corners of a pipe's cross-section: a reader may come as near as he likes."""
NORMAL_STEPS = 127
"""A component of a normal is a whole number up to this, one byte."""
POSITION_STEP = 1e-5
"""Step of the positions of bodies, m."""
TURN_STEP = 1 / 32767
"""Step of the components of quaternions: 3e-5 rad, or 3 micrometres at the robot's rim."""
FARTHER = 1.35
"""Distance of the camera that follows, over that in films: a page can be zoomed."""
TIME_STEP = 1e-6
"""Step of the times, s."""


class Shapes:
    """Surfaces in a pack, each once, however many bodies or pipes have it."""

    def __init__(self, pack: Pack) -> None:
        self.tables: list[dict[str, Any]] = []
        self._pack = pack
        self._known: dict[bytes, int] = {}

    def add(self, surface: Surface) -> int:
        """Return the number of a surface."""
        normal = np.rint(NORMAL_STEPS * surface.normal).astype(np.int64)
        key = b"".join(a.tobytes() for a in (surface.position, normal, surface.faces))
        if key not in self._known:
            self._known[key] = len(self.tables)
            self.tables.append(
                {
                    "vertices": self._pack.ranged(surface.position),
                    "normals": self._pack.whole(normal),
                    "faces": self._pack.whole(surface.faces.ravel()),
                }
            )
        return self._known[key]


def robot_table(playback: Playback, pack: Pack, shapes: Shapes) -> dict[str, Any]:
    """Return the robot and how it moves, the body that cameras keep with first.

    Bodies but for tracks have poses over time; a track lies on its carrier, as far along its axis
    as it has run within half a visible pitch.
    """
    model, first, tracks = playback.model, playback.body, playback.tracks
    numbers = [first, *(i for i in range(1, model.nbody) if i != first)]
    names = {i: model.body(i).name or f"body_{i}" for i in numbers}
    moved = [i for i in numbers if names[i] not in tracks]
    poses = playback.body_poses(moved)
    place = {names[i]: index for index, i in enumerate(moved)}
    bodies = []
    for i in numbers:
        table = _body(playback, i, names[i], shapes)
        if names[i] in tracks:
            track = tracks[names[i]]
            axis = np.array(model.joint(track.joint).axis)
            table |= {"on": place[track.carrier], "axis": rounded(axis, 6)}
            table |= {"column": track.column, "side": track.side}
        bodies.append(table)
    samples = len(poses)
    return {
        "bodies": bodies,
        "moved": [names[i] for i in moved],
        "badges": [[place[one.body], one.text, css(one.colour)] for one in playback.badges],
        "positions": pack.steps(poses[..., :3].reshape(samples, -1), POSITION_STEP),
        "turns": pack.steps(poses[..., 3:].reshape(samples, -1), TURN_STEP),
        "travel": pack.steps(playback.track_travel, POSITION_STEP),
        "pitch": playback.track_pitch,
        "scale": playback.size,
    }


def _body(playback: Playback, body: int, name: str, shapes: Shapes) -> dict[str, Any]:
    """Return the surface of a body, and how many of its vertices have which colour."""
    geoms = [geom for geom in playback.visible_geoms if playback.model.geom_bodyid[geom] == body]
    if not geoms:
        return {"name": name}
    surface = geoms_surface(playback.model, geoms, fine=True)
    paint = surface.colour[:, :3]
    first = np.flatnonzero((np.diff(paint, axis=0, prepend=-1.0) != 0).any(axis=1))
    counts = np.diff(np.append(first, len(paint))).tolist()
    colours = [[count, rounded(paint[i], 4)] for i, count in zip(first, counts, strict=True)]
    return {"name": name, "shape": shapes.add(surface), "colours": colours}


def onboard_table(playback: Playback) -> dict[str, Any] | None:
    """Return the camera on board, its lamp, and the number of their body; None without one."""
    mount, model = playback.page_camera, playback.model
    if mount is None or model.body(mount.body).id == 0:
        return None
    first, body = playback.body, model.body(mount.body).id
    frame, place = np.array(mount.frame), np.array(mount.position)
    return {
        "body": 0 if body == first else body + 1 if body < first else body,
        "position": rounded(place, 6),
        "frame": rounded(frame, 7),
        "fov": mount.angle_deg,
        "lamp": rounded(place - LAMP_AHEAD * playback.size * frame[:, 2], 6),
    }


def pipes_table(playback: Playback, shapes: Shapes) -> dict[str, Any]:
    """Return the pipes, the plates, and the directions of the camera that sees all.

    Of each part there are the half that stays when it is cut open towards the film's viewer, the
    half cut away, its inside, the rings that a camera within sees, and where it lies.
    """
    network, model = playback.network, playback.model
    towards = view_direction(network)

    def piece(surface: Surface, pose: Pose) -> dict[str, Any]:
        place = {"position": rounded(pose.position, 6), "turn": rounded(pose.quaternion, 7)}
        return {"shape": shapes.add(surface)} | place

    def marks_of(part: Part) -> dict[str, Any] | None:
        """Return the rings that a camera within sees; None of a part that is too short."""
        own = rings(Part(part.name, part.fitting, Pose()))
        return piece(Surface.joined(own), part.pose) if own else None

    parts = []
    for part in network.parts:
        fitting, rotation, samples = part.fitting, part.pose.rotation, part.bore_samples()
        local = rotation.T @ towards
        pieces = opened_pipe(fitting, local, SECTIONS)
        kept, front, inside = (piece(surface, part.pose) for surface in pieces)
        table = {
            "name": part.name,
            "kept": kept,
            "front": front,
            "inside": inside,
            "marks": marks_of(part),
            "cut": rounded(rotation @ cut_normal(fitting, local), 6),
            "low": rounded(samples.min(axis=0) - THICKNESS, 4),
            "high": rounded(samples.max(axis=0) + THICKNESS, 4),
        }
        parts.append(table)
    plates = [geoms_surface(model, [geom], fine=True) for geom in playback.still]
    return {
        "parts": parts,
        "plates": [piece(p, Pose()) | {"colour": rounded(p.colour[0, :3], 4)} for p in plates],
        "pipe": rounded(PIPE_LOOK[0], 4),
        "mark": rounded(MARK, 4),
        "towards": rounded(towards, 6),
        "back": rounded(follow_direction(network), 6),
        "fov": FIELD_OF_VIEW,
    }


def scene_data(playbacks: Sequence[Playback], pack: Pack) -> dict[str, Any]:
    """Return what a page draws in space: robots, pipes and cameras."""
    first, shapes = playbacks[0], Shapes(pack)
    back = view_directions(first, follow_direction(first.network))
    return {
        "runs": [run_table(playback, pack, shapes) for playback in playbacks],
        "pipes": pipes_table(first, shapes),
        "follow": {
            "distance": FARTHER * DISTANCE * first.size,
            "directions": pack.steps(back, 1e-4),
        },
        "onboard": onboard_table(first),
        "arrows": force_kinds(first.arrows, first.size),
        "shapes": shapes.tables,
    }
