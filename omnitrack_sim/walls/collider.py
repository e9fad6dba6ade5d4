"""Exact contact with fittings of any kind, compiled into MuJoCo's collision table.

A fitting is one height field, whose user data say what it is (``record``). Of all pairs of geoms
MuJoCo gives those with a height field the most room for contacts (50). A height field without a
record, and a geom with a record of its own, are handed to the function that was there before. The
compiled functions hold no interpreter lock, so batches scale over threads.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from ctypes import CFUNCTYPE
from functools import cache
from typing import Any

import mujoco
from llvmlite import binding, ir

from omnitrack_sim.pipes.compiled import SOLID, compiled
from omnitrack_sim.pipes.fittings.base import MAX_SIZES
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBER,
    NUMBERS,
    WORD,
    WORDS,
    at,
    c_function,
    call_surface,
    calling,
    doubles,
    floats,
    integers,
    intrinsic,
    row,
    scratch,
    words,
)
from omnitrack_sim.walls.bodies import (
    box,
    capsule,
    cylinder,
    ellipsoid,
    frame_in,
    mesh,
    point_in,
    sphere,
    wall_of,
)
from omnitrack_sim.walls.contacts import CONTACT_SIZE, MAX_KEPT, add_apart, in_world
from omnitrack_sim.walls.curves import holds
from omnitrack_sim.walls.layout import library, words_of
from omnitrack_sim.walls.record import (
    DEPTH,
    DEPTH_IN_BORE,
    KIND,
    KIND_SIZE,
    LONG,
    MARK,
    ORDER,
    PARTS,
    PLATE,
    RECORD_SIZE,
    SIZES,
    WALL_BEFORE,
    LongSizes,
    kinds,
    long_sizes,
)
from omnitrack_sim.walls.record import SIZE as SIZE_OF_BORE
from omnitrack_sim.walls.rims import (
    BOX,
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    MESH,
    RIM,
    SPHERE,
    rim_contacts,
)

GEOM = mujoco.mjtGeom
_PLANE, _FIELD, _TYPES = (
    int(kind) for kind in (GEOM.mjGEOM_PLANE, GEOM.mjGEOM_HFIELD, GEOM.mjNGEOMTYPES)
)
_COLLIDE = CFUNCTYPE(INTEGER, WORDS, WORDS, NUMBERS, INTEGER, INTEGER, NUMBER)
"""C types of MuJoCo's collision functions (mjfCollision): model, data, room for contacts, the two
geoms, margin."""
BLOCK = "omnitrack_collider_block"
"""Symbol of the words that change from process to process and from one MuJoCo to the next. Compiled
code reads them when it runs, so it can be kept on disk."""
PREVIOUS = 0
PLANE_PREVIOUS = PREVIOUS + _TYPES
LINE_PREVIOUS = PLANE_PREVIOUS + _TYPES
KINDS, USER_SIZE, GEOM_COUNT = LINE_PREVIOUS + 1, LINE_PREVIOUS + 2, LINE_PREVIOUS + 3
MODEL_FIELDS = (
    "geom_size",
    "geom_user",
    "geom_type",
    "geom_rbound",
    "geom_dataid",
    "mesh_vertadr",
    "mesh_vertnum",
    "mesh_vert",
    "mesh_polymapnum",
    "mesh_polyadr",
    "mesh_polynum",
    "mesh_polyvertadr",
    "mesh_polyvertnum",
    "mesh_polyvert",
    "mesh_polynormal",
    "geom_priority",
    "geom_solmix",
    "geom_solref",
)
(
    SIZE,
    USER,
    TYPE,
    BOUND,
    DATA_ID,
    VERTICES_AT,
    VERTEX_COUNT,
    VERTICES,
    POLYGONS_OF,
    POLYGONS_AT,
    POLYGON_COUNT,
    POLYGON_BEGINS,
    POLYGON_SIZES,
    POLYGON_VERTICES,
    POLYGON_NORMALS,
    PRIORITY,
    SOLMIX,
    SOLREF,
) = range(GEOM_COUNT + 1, GEOM_COUNT + 1 + len(MODEL_FIELDS))
POSITIONS = SOLREF + 1
MATRICES = POSITIONS + 1
RAISE, MESSAGES = MATRICES + 1, MATRICES + 2
LONG_SIZES = MESSAGES + 4
BLOCK_SIZE = LONG_SIZES + 1
"""Indices in the block, and its size: functions that were there before for height fields, those
for planes, both by the type of the other geom, and that before for lines; address of the table of
kinds; words of MuJoCo's mjModel that hold the length of user data, the number of geoms and the
fields; those of mjData that hold positions and orientations of geoms; addresses of MuJoCo's
function that raises an error, of the messages of ``guard``, and of the table of long sizes."""
SOFT_IN_BORE, FIRM_TIME = 0.1, 0.005
"""Depth, in radii of the bore, below which a wall is as stiff as by this contact time, s, at least.
A body at 12 m/s sinks in by 84 mm with MuJoCo's own 20 ms, and by 21 mm with 5 ms, which a step of
2 ms still resolves."""


@intrinsic
def word(_context, _index):
    """Read a word of the block."""

    def code(_context, builder, _signature, arguments):
        module, kind = builder.module, ir.IntType(64)
        block = module.globals.get(BLOCK)
        if block is None:  # without an initialiser it is an external symbol
            block = ir.GlobalVariable(module, ir.ArrayType(kind, BLOCK_SIZE), BLOCK)
        return builder.load(builder.gep(block, [kind(0), arguments[0]], inbounds=True))

    return CFUNCTYPE(WORD, WORD), code


@intrinsic
def call_collide(_context, _address, _model, _data, _contacts, _wall, _geom, _margin):
    """Call the collision function at an address."""
    return calling(_COLLIDE)


@compiled
def functions_of(number):
    """Addresses of ``surface`` and ``span`` of the kind of a number, and its number of solids.

    They are 0 where it is not known.
    """
    table = words(word(KINDS))
    for i in range(table[0]):
        k = 1 + KIND_SIZE * i
        if table[k] == number:
            return table[k + 1], table[k + 2], table[k + 3]
    return 0, 0, 0


_ROOM = LongSizes.ROOM


@compiled
def long_sizes_at(records, w):
    """Address of the long sizes of the wall whose record begins at ``w``; 0 where unknown."""
    table, first = words(word(LONG_SIZES)), int(records[w + SIZES])
    for k in range(_ROOM):
        row = 3 * ((first + k) % _ROOM)
        if table[row + 2] == 0:
            break
        if table[row] == first and table[row + 1] == int(records[w + SIZES + 1]):
            return table[row + 2]
    return 0


@compiled
def sizes_of(records, w):
    """Sizes of the wall whose record begins at ``w``."""
    return doubles(long_sizes_at(records, w)) if records[w + LONG] > 0.0 else at(records, w + SIZES)


@compiled
def hull_of(model, geom):
    """Return the hull of a mesh geom, see ``bodies.mesh``, and normals of its polygons.

    For a geom below 0, it is nothing that may be read.
    """
    if geom < 0:
        none = integers(0)
        return (floats(0), 0, none, 0, none, none, none), doubles(0)
    number = integers(model[word(DATA_ID)])[geom]
    vertices_at = integers(model[word(VERTICES_AT)])[number]
    polygons_at = integers(model[word(POLYGONS_AT)])[number]
    begins = integers(model[word(POLYGON_BEGINS)] + 4 * polygons_at)
    hull = (
        floats(model[word(VERTICES)] + 12 * vertices_at),
        integers(model[word(VERTEX_COUNT)])[number],
        integers(model[word(POLYGONS_OF)] + 4 * vertices_at),
        integers(model[word(POLYGON_COUNT)])[number],
        begins,
        integers(model[word(POLYGON_SIZES)] + 4 * polygons_at),
        integers(model[word(POLYGON_VERTICES)]),
    )
    return hull, doubles(model[word(POLYGON_NORMALS)] + 24 * polygons_at)


@compiled
def _contacts(model, con, wall, frame, geom, kind, out):
    """Find the contacts of a geom, in the fitting's frame; returns their number."""
    sizes = doubles(model[word(SIZE)] + 24 * geom)
    a, b, c = sizes[0], sizes[1], sizes[2]
    if kind == SPHERE:
        return sphere(con, 0, wall, frame, a, out)
    reach = doubles(model[word(BOUND)])[geom]
    # Most geoms near a wall's box do not touch the wall.
    x, y, z = frame[0], frame[1], frame[2]
    if (
        holds(wall, x, y, z, out)
        and call_surface(wall[0], wall[2], x, y, z, out) >= reach + wall[5]
    ):
        return 0
    if kind == CAPSULE:
        return capsule(con, 0, wall, frame, a, b, out)
    if kind == BOX:
        return box(con, 0, wall, frame, a, b, c, out)
    if kind == CYLINDER:
        return cylinder(con, 0, wall, frame, a, b, out)
    if kind == ELLIPSOID:
        return ellipsoid(con, 0, wall, frame, a, b, c, out)
    return mesh(con, 0, wall, frame, hull_of(model, geom)[0], out)


@compiled
def _contacts_of_each(model, con, wall, solids, frame, geom, kind, out):
    """Find the contacts of a geom with each of the solids of a wall; returns their number."""
    surface, span, whole, ends, depth, margin, same, spacing, size, bumps, waves = wall
    sizes, kept, total = row(), scratch(), 0
    for i in range(MAX_SIZES):
        sizes[i] = whole[i]
    for k in range(solids):
        sizes[SOLID] = k + 1.0
        one = surface, span, sizes, ends, depth, margin, same, spacing, size, bumps, waves
        n = _contacts(model, con, one, frame, geom, kind, out)
        total = add_apart(kept, total, con, n, same)
    for i in range(total * CONTACT_SIZE):
        con[i] = kept[i]
    return total


@compiled
def _touch_rim(model, con, records, w, frame, geom, kind, margin, out):
    """Find the contacts of a geom with the edge of a wall, see ``rims``."""
    sizes = doubles(model[word(SIZE)] + 24 * geom)
    hull, normals = hull_of(model, geom if kind == MESH else -1)
    bound = doubles(model[word(BOUND)])[geom]
    return rim_contacts(
        con, records, w, kind, sizes, bound, hull, normals, frame, margin, MAX_KEPT, out
    )


@compiled
def _firmness(model, wall, geom):
    """Return the ratio, at least 1, of a firm wall's stiffness to that of the contact of two geoms.

    MuJoCo takes the numbers from the geom of higher priority, or mixes them.
    """
    priority, mix = integers(model[word(PRIORITY)]), doubles(model[word(SOLMIX)])
    mixes = priority[wall] == priority[geom]
    part = 1.0 * (priority[wall] > priority[geom])
    if mixes and mix[wall] > 0.0:
        part = mix[wall] / (mix[wall] + mix[geom])
    of_wall = doubles(model[word(SOLREF)] + 16 * wall)
    of_geom = doubles(model[word(SOLREF)] + 16 * geom)
    time = part * of_wall[0] + (1.0 - part) * of_geom[0]
    damping = part * of_wall[1] + (1.0 - part) * of_geom[1]
    if mixes and min(of_wall[0], of_geom[0]) <= 0.0:
        time, damping = min(of_wall[0], of_geom[0]), min(of_wall[1], of_geom[1])
    # Numbers below 0 are stiffness and damping themselves.
    square = time * time * damping * damping if time > 0.0 else -1.0 / min(time, -1e-9)
    return max(1.0, square / (FIRM_TIME * FIRM_TIME))


@compiled
def _touch_plate(model, data, con, records, w, plate, geom, kind, margin):
    """Find the contacts of a geom with a plate that closes a pipe: those with a plane of MuJoCo's.

    A body whose middle is beside or behind the plate may be one in another pipe.
    """
    size, depth = records[w + SIZE_OF_BORE], records[w + DEPTH]
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    a, b, m = 3 * geom, 3 * plate, 9 * plate
    x, y, z = position[a], position[a + 1], position[a + 2]
    u, v, t = x - position[b], y - position[b + 1], z - position[b + 2]
    before = matrix[m + 2] * u + matrix[m + 5] * v + matrix[m + 8] * t
    within = size - math.sqrt(max(u * u + v * v + t * t - before * before, 0.0))
    own, wall = min(before, within), plate - int(records[w + WALL_BEFORE])
    if before <= -depth or within <= -DEPTH_IN_BORE * size:
        return 0
    if own < 0.0 and _from_others(model, data, wall, x, y, z, own, row()) > own:
        return 0
    n = call_collide(word(PLANE_PREVIOUS + kind), model, data, con, plate, geom, margin)
    for i in range(n):
        _make_firm(model, con, i * CONTACT_SIZE, size, depth, plate, geom)
    return n


@compiled
def _from_others(model, data, wall, x, y, z, enough, out):
    """Return the distance, m, of a point of the world from the wall of the roomiest other bore.

    It is negative in that wall, and minus infinity where no other fitting of the network holds the
    point. The search ends at one over ``enough``.
    """
    length, records, farthest = model[word(USER_SIZE)], doubles(model[word(USER)]), -math.inf
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    own = length * (wall + 1) - RECORD_SIZE
    first = wall - int(records[own + ORDER])
    for other in range(first, first + int(records[own + PARTS])):
        if other != wall:
            w = length * (other + 1) - RECORD_SIZE
            px, py, pz = point_in(records, w, position, matrix, x, y, z, other)
            surface, span, _ = functions_of(records[w + KIND])
            walls = wall_of(surface, span, sizes_of(records, w), records, w, 0.0, 0.0, 0.0)
            if holds(walls, px, py, pz, out):
                farthest = max(farthest, call_surface(surface, walls[2], px, py, pz, out))
                if farthest > enough:
                    break
    return farthest


@compiled
def _depth_at(model, data, con, k, wall, whole, out):
    """Return the depth, m, of a wall at a contact: half of the way to another bore."""
    half = 0.5 * con[k]
    x, y, z = (
        con[k + 1] - half * con[k + 4],
        con[k + 2] - half * con[k + 5],
        con[k + 3] - half * con[k + 6],
    )
    return min(whole, max(-0.5 * _from_others(model, data, wall, x, y, z, 0.0, out), 0.0))


def collide(model, data, contacts, wall, geom, margin):
    """MuJoCo's collision function of a height field and a geom of any of the six types."""
    kind = integers(model[word(TYPE)])[geom]
    count = model[word(USER_SIZE)]
    # A foreign model may have user data of another length, which must not be read as a record.
    if count < RECORD_SIZE:
        return call_collide(word(PREVIOUS + kind), model, data, contacts, wall, geom, margin)
    records = doubles(model[word(USER)])
    # The records end the rows, so that a robot may have user data of its own before.
    w, own = count * (wall + 1) - RECORD_SIZE, count * (geom + 1) - RECORD_SIZE
    if records[w] != MARK or records[own] == MARK:
        return call_collide(word(PREVIOUS + kind), model, data, contacts, wall, geom, margin)
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    if records[w + KIND] == PLATE:
        return _touch_plate(model, data, contacts, records, w, wall, geom, kind, margin)
    frame = frame_in(records, w, position, matrix, geom, wall)
    if records[w + KIND] == RIM:
        n = _touch_rim(model, contacts, records, w, frame, geom, kind, margin, row())
    else:
        surface, span, solids = functions_of(records[w + KIND])
        reach = doubles(model[word(BOUND)])[geom]
        out = row()
        depth = records[w + DEPTH]
        sizes = sizes_of(records, w)
        walls = wall_of(surface, span, sizes, records, w, depth, margin, reach)
        x, y, z = frame[0], frame[1], frame[2]
        whole = DEPTH_IN_BORE * records[w + SIZE_OF_BORE]
        # Beside another pipe a point in the wall may be one of a body in that pipe. The body's
        # middle decides: a convex body cannot have it in one pipe and touch another.
        if depth < whole and holds(walls, x, y, z, out):
            d = call_surface(surface, walls[2], x, y, z, out)
            a = 3 * geom
            x, y, z = position[a], position[a + 1], position[a + 2]
            if d <= -depth and _from_others(model, data, wall, x, y, z, d, out) > d:
                return 0
            walls = wall_of(surface, span, sizes, records, w, whole, margin, reach)
        if solids > 1:
            n = _contacts_of_each(model, contacts, walls, solids, frame, geom, kind, out)
        else:
            n = _contacts(model, contacts, walls, frame, geom, kind, out)
    for i in range(n):
        in_world(contacts, i * CONTACT_SIZE, records, w, position, matrix, wall)
    size, thin = records[w + SIZE_OF_BORE], records[w + DEPTH]
    for i in range(n):
        k = i * CONTACT_SIZE
        if contacts[k] < -min(SOFT_IN_BORE * size, 0.5 * thin):
            depth = DEPTH_IN_BORE * size
            if records[w + KIND] == RIM:
                depth = thin
            elif thin < depth:
                depth = max(thin, _depth_at(model, data, contacts, k, wall, depth, row()))
            _make_firm(model, contacts, k, size, depth, wall, geom)
    return n


@compiled
def _make_firm(model, con, k, size, depth, wall, geom):
    """Make a contact deeper than ``SOFT_IN_BORE``, or than half of a thin wall, a firm one.

    What is deeper counts as often as that takes.
    """
    soft = min(SOFT_IN_BORE * size, 0.5 * depth)
    if con[k] < -soft:
        con[k] = -soft + _firmness(model, wall, geom) * (con[k] + soft)


entered: dict[int, Callable[..., int]] = {}
"""Functions that stand in MuJoCo's table, by where the address of the one before is kept."""


def enter(function: Callable[..., int], geom: int, before: int) -> None:
    """Enter a compiled function in MuJoCo's table, for height fields and a type of geom.

    Args:
        function: plain Python that compiles to a ``mjfCollision``.
        geom: type of the other geom.
        before: index in the block of the address of the function that was there.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    # The height field comes first: the table is filled for pairs of ascending geom types only.
    place = _FIELD * _TYPES + int(geom)
    block_of_process()[before] = _in_table(place)
    entered[before] = function
    _table()[place] = c_function(function, _COLLIDE, is_long=True).address


def _table() -> Any:
    """Return MuJoCo's table of collision functions, by the types of both geoms."""
    return (ctypes.c_void_p * (_TYPES * _TYPES)).in_dll(library(), "mjCOLLISIONFUNC")


def _in_table(place: int) -> int:
    """Return the address of a collision function."""
    address = _table()[place]
    if not address:
        types = divmod(place, _TYPES)
        raise RuntimeError(f"MuJoCo's collision table has no function for geoms of types {types}")
    return address


@cache
def install() -> None:
    """Enter the collider in MuJoCo's table, once a process.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    for kind in (SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH):
        block_of_process()[PLANE_PREVIOUS + kind] = _in_table(_PLANE * _TYPES + kind)
        enter(collide, kind, PREVIOUS + kind)


@cache
def block_of_process() -> Any:
    """Return the block that compiled code reads, kept for good."""
    block = (ctypes.c_int64 * BLOCK_SIZE)()
    block[KINDS] = kinds.table.ctypes.data
    block[LONG_SIZES] = long_sizes.table.ctypes.data
    block[USER_SIZE:RAISE] = [
        *words_of("mjModel", ("nuser_geom", "ngeom", *MODEL_FIELDS)),
        *words_of("mjData", ("geom_xpos", "geom_xmat")),
    ]
    # Before any code that refers to it is loaded.
    binding.add_symbol(BLOCK, ctypes.addressof(block))
    return block
