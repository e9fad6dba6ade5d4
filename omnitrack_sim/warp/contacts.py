"""Contacts with exact walls as a native function of Warp, made of what the collider is made of."""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Mapping
from functools import cache, partial
from typing import Any

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.pipes import Fitting
from omnitrack_sim.pipes.fittings import relieved
from omnitrack_sim.pipes.fittings.base import ADDRESS
from omnitrack_sim.pipes.native import (
    ROW,
    SCRATCH,
    at,
    call_clear,
    call_span,
    call_surface,
    row,
    scratch,
)
from omnitrack_sim.pipes.obstacles import Obstacle
from omnitrack_sim.walls import bodies, collider, rims
from omnitrack_sim.walls.contacts import CONTACT_SIZE, MAX_OF_PAIR
from omnitrack_sim.walls.record import LONG, MARK, PLATE, RECORD_SIZE, SIZES, kind_number
from omnitrack_sim.warp.planes import with_plane
from omnitrack_sim.warp.translation import (
    INT,
    INTS,
    REAL,
    REALS,
    Code,
    Translation,
    TranslationError,
    _Body,
)

SINGLE = {
    "ACCURACY": 2e-6,
    "AS_FAR": 1e-7,
    "AT_RIM": 1e-6,
    "BEYOND_END": 8e-7,
    "ELLIPSE_ACCURACY": 1e-6,
    "FLAT": 1e-6,
    "POSITION": 5e-7,
    "ROUNDING": 1e-6,
    "SAME_PLACE": 3e-7,
    "SETTLED": 1e-6,
    "_CLOSE": 1e-4,
    "_SAME_DIRECTION": 1e-7,
}
"""Accuracies of searches in single precision, by the names that those of double precision have."""
MODEL = "Model"
FIELDS: dict[str, str] = {
    "SIZE": REALS,
    "USER": REALS,
    "TYPE": INTS,
    "BOUND": REALS,
    "DATA_ID": INTS,
    "VERTICES_AT": INTS,
    "VERTEX_COUNT": INTS,
    "VERTICES": REALS,
    "POLYGONS_OF": INTS,
    "POLYGONS_AT": INTS,
    "POLYGON_COUNT": INTS,
    "POLYGON_BEGINS": INTS,
    "POLYGON_SIZES": INTS,
    "POLYGON_VERTICES": INTS,
    "POLYGON_NORMALS": REALS,
    "PRIORITY": INTS,
    "SOLMIX": REALS,
    "SOLREF": REALS,
    "POSITIONS": REALS,
    "MATRICES": REALS,
}
"""Fields of MuJoCo's structures by the names of their words in ``walls.collider``."""
SHAPES = {
    rims.CAPSULE: bodies.capsule,
    rims.CYLINDER: bodies.cylinder,
    rims.ELLIPSOID: bodies.ellipsoid,
    rims.BOX: bodies.box,
    rims.MESH: bodies.mesh,
}
"""Functions that find the contacts of a type of geom; those of spheres are always there."""
FACES = (bodies.face_of, bodies.round_face, bodies.mesh_face)
"""Functions that add contacts within faces, of which there are none where no wall has relief."""
SURFACE, SPAN = (REALS, REAL, REAL, REAL, REALS), (REALS, REALS, *[REAL] * 6, REALS)
"""Types of the arguments of ``compiled.Wall``'s functions."""
LINE = -1
"""Kind of geom that stands for rows of lugs, which are capsules with a record."""
WallKind = type[Fitting] | type[Obstacle]
"""What a wall is that of."""


def translation(
    fittings: Collection[WallKind], shapes: Collection[int], uneven: Collection[WallKind] = ()
) -> Translation:
    """Return what translates the collider for some fittings and types of geoms.

    Args:
        fittings: kinds of walls.
        shapes: types of geoms.
        uneven: those of the fittings of which a wall has heights over its bore.

    Raises:
        GeometryError: the wall of a fitting cannot be translated.
    """
    absent = [function for kind, function in SHAPES.items() if kind not in shapes]
    walls = {kind_number(each.file_kind()): each.wall for each in fittings}
    solids = {number: wall.solids for number, wall in walls.items() if wall.solids > 1}
    known = intrinsics() | {collider.functions_of: partial(_functions_of, solids)}
    if uneven:
        known[relieved.from_relief] = _from_relief
    if not uneven and Obstacle not in fittings:
        known |= dict.fromkeys(FACES, lambda body, node: body.value(node.args[1]))
    whole = Translation(known, SINGLE, absent, structures=(MODEL,))
    surfaces = {number: wall.surface for number, wall in walls.items()}
    spans = {number: wall.span for number, wall in walls.items()}
    for each in fittings:
        try:
            whole.function(each.wall.surface, SURFACE)
            whole.function(each.wall.span, SPAN)
        except TranslationError as error:
            problem = f"its wall cannot be translated for a device: {error}"
            raise GeometryError(Fault(each.file_kind(), problem)) from error
    whole.dispatcher("surface", surfaces, SURFACE)
    whole.dispatcher("span", spans, SPAN)
    if uneven:
        heights = {kind_number(each.file_kind()): each.relieved_surface for each in uneven}
        whole.dispatcher("relief", heights, SURFACE)
    return whole


def structure(
    fittings: Collection[WallKind], shapes: Collection[int], uneven: Collection[WallKind]
) -> str:
    """Return the C++ structure ``Walls``, whose ``contacts`` finds those of one pair of geoms.

    Arguments: see ``translation``.
    """
    whole = translation(fittings, shapes, uneven)
    kinds = [MODEL, MODEL, REALS, INT, INT, REAL]
    roots = [whole.function(collider.collide, kinds).name]
    lines = ""
    if LINE in shapes:
        roots.append(whole.function(collider.entered[collider.LINE_PREVIOUS], kinds).name)
        lines = f"""
    if (model.USER[model.USER_SIZE * (geom + 1) - {RECORD_SIZE}] == real({MARK!r}))
      return {roots[1]}(model, model, con, wall, geom, margin);"""
    fields = " ".join(f"{kind} {name};" for name, kind in FIELDS.items())
    return f"""struct Walls {{
  typedef float real;
  struct Model {{ int USER_SIZE; {fields} }};
{whole.members(*roots)}
  CUDA_CALLABLE static int contacts(
    const Model& model, real* con, int wall, int geom, real margin
  ) {{{lines}
    return {roots[0]}(model, model, con, wall, geom, margin);
  }}
}};
"""


def room(fittings: Collection[WallKind], shapes: Collection[int]) -> int:
    """Numbers that the contacts of one pair need room for."""
    # A mesh keeps distances of its vertices behind its contacts, and each solid of a wall has its
    # own; all others have 24 at most.
    many = rims.MESH in shapes or any(each.wall.solids > 1 for each in fittings)
    return CONTACT_SIZE * (MAX_OF_PAIR if many else 25)


@cache
def intrinsics() -> dict[Any, Callable[[_Body, Any], Code]]:
    """Return how functions are written that numba has as instructions."""
    return {
        at: _at,
        row: lambda body, _: _room(body, ROW),
        scratch: lambda body, _: _room(body, SCRATCH),
        call_surface: lambda body, node: _dispatch(body, node, "surface"),
        call_span: lambda body, node: _dispatch(body, node, "span"),
        call_clear: lambda body, node: _dispatch(body, node, "clear"),
        collider.call_collide: _call_collide,
        collider.sizes_of: _sizes_of,
        # Where no wall is uneven it is not reached.
        relieved.from_relief: lambda body, node: Code("0", REAL),  # noqa: ARG005
        collider.doubles: lambda body, node: _pointer(body, node, 8),
        collider.floats: lambda body, node: _pointer(body, node, 4),
        collider.integers: lambda body, node: _pointer(body, node, 4),
        MODEL: _word,
    }


def _sizes_of(body: _Body, node: ast.Call) -> Code:
    """Sizes in a wall's record; long ones follow all records, from an index on that is there."""
    records, w = (body.temporary(body.value(each)).text for each in node.args)
    place = f"{w} + {SIZES}"
    index = f"{records}[{w} + {LONG}] > real(0) ? (int){records}[{place}] : {place}"
    return Code(f"({records} + ({index}))", REALS)


def _from_relief(body: _Body, node: ast.Call) -> Code:
    """The number of the fitting stands for the address of its surface with relief."""
    sizes, *others = (body.value(each).text for each in node.args)
    body.called.add("relief")
    return Code(f"relief((int){sizes}[{ADDRESS}], {', '.join([sizes, *others])})", REAL, True)


def _at(body: _Body, node: ast.Call) -> Code:
    array, index = map(body.value, node.args)
    return Code(f"({array.text} + {index.text})", array.kind)


def _room(body: _Body, count: int) -> Code:
    """Room for numbers on the stack of the function."""
    return body.room(count)


def _dispatch(body: _Body, node: ast.Call, name: str) -> Code:
    arguments = ", ".join(body.value(each).text for each in node.args)
    body.called.add(name)
    return Code(f"{name}({arguments})", REAL, writes=True)


def _functions_of(solids: Mapping[int, int], body: _Body, node: ast.Call) -> Code:
    """The number of a fitting stands for the addresses of both of its functions; 0 for none.

    Args:
        solids: how many a wall is made of, by the number of the fitting, where it is more than one.
        body: of the function that calls.
        node: the call.
    """
    number, kind = body.temporary(body.value(node.args[0])).text, (INT, INT, INT)
    address = f"{number} > real({PLATE}) ? (int)({number}) : 0"
    count = "".join(f"(int)({number}) == {each} ? {n} : " for each, n in solids.items()) + "1"
    return Code(f"{body.whole.type_name(kind)}{{{address}, {address}, {count}}}", kind)


def _call_collide(body: _Body, node: ast.Call) -> Code:
    """What was in MuJoCo's table before: for plates that of planes; else it is not reached."""
    if "PLANE_PREVIOUS" in ast.unparse(node.args[0]):
        return body.call(with_plane, node.args[1:])
    return Code("0", INT)


def _word(body: _Body, node: ast.Subscript) -> Code:
    """A field of a structure of MuJoCo's, at ``structure[word(NAME)]``."""
    assert isinstance(node.slice, ast.Call)
    name, base = ast.unparse(node.slice.args[0]), body.value(node.value)
    if name == "USER_SIZE":
        return Code(f"{base.text}.{name}", INT)
    return Code(f"{base.text}.{name}", FIELDS[name])


def _pointer(body: _Body, node: ast.Call, size: int) -> Code:
    """A pointer to numbers: at a field, or some octets after it, as numba knows them."""
    place = node.args[0]
    if isinstance(place, ast.Constant):
        kind = INTS if ast.unparse(node.func) == "integers" else REALS
        return Code(f"({kind})0", kind)
    if isinstance(place, ast.BinOp):
        base, octets = body.value(place.left), body.value(place.right)
        return Code(f"({base.text} + {octets.text} / {size})", base.kind)
    return body.value(place)
