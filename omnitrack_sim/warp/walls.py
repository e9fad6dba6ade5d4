"""Exact walls of a model in MuJoCo Warp: ``put_model``, and the callback that finds contacts."""

from __future__ import annotations

import copy
from collections.abc import Collection
from functools import cache
from typing import Any, NamedTuple

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.pipes.fittings.base import ADDRESS
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.pipes.obstacles import Obstacle
from omnitrack_sim.walls.collider import LINE_PREVIOUS, entered
from omnitrack_sim.walls.contacts import CONTACT_SIZE
from omnitrack_sim.walls.guard import PLUGIN
from omnitrack_sim.walls.record import (
    KIND,
    LONG,
    MARK,
    PLATE,
    RECORD_SIZE,
    SIZES,
    kinds,
    long_sizes,
)
from omnitrack_sim.walls.rims import CAPSULE, SPHERE
from omnitrack_sim.warp import kernels
from omnitrack_sim.warp.contacts import LINE, SHAPES, WallKind, room, structure

_FIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
GEOMS = ("condim", "priority", "solmix", "solref", "solimp", "friction", "margin", "gap")
PAIRS = ("dim", "solref", "solreffriction", "solimp", "margin", "gap", "adhesion", "friction")
CONTACT_PARAMETERS = (
    *(f"geom_{name}" for name in (*GEOMS, "adhesion")),
    *(f"pair_{name}" for name in PAIRS),
)
"""Fields of MuJoCo Warp's model that say how geoms touch, in the order of ``add_contacts``."""
CONTACT_FIELDS = (
    *("dist", "pos", "frame", "includemargin", "friction", "solref", "solreffriction", "solimp"),
    *("dim", "geom", "efc_address", "worldid", "type", "geomcollisionid", "adhesion"),
)
"""Fields of its contacts, in the order of ``add_contacts``."""


MAX_NUMBERS = 1 << 24
"""Of records and relief: a number of single precision counts no farther."""


class Work(NamedTuple):
    """Arrays that the walls of a number of worlds work on.

    Attributes:
        near: pairs near to each other: world, and number in ``Walls.pairs``.
        near_count: (1,) how many.
        found: contacts, see ``kernels.Found``.
    """

    near: Any
    near_count: Any
    found: Any


class Walls:
    """Exact walls of a model on a device: MuJoCo Warp's ``callback.contactfilter``.

    Attributes:
        pairs: (n, 2) numbers of geoms that may touch: walls, rims or plates, and the robot's.
        origins: (nworld,) vectors, m, where the origin of each world's positions lies in the pipes;
            None where it is theirs.
        free: addresses in ``qpos`` of the bodies that are free in the world; None where another
            joint holds one.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        rows = np.asarray(model.geom_user, float)
        rows = rows[:, -RECORD_SIZE:] if model.nuser_geom >= RECORD_SIZE else rows[:, :0]
        has_record = (rows[:, :1] == MARK).any(axis=1)
        is_wall = has_record & (model.geom_type == _FIELD)
        if not is_wall.any():
            problem = "has no exact walls: ot.add_pipes(spec, network) adds them before compilation"
            raise InputError(Fault("model", problem))
        pairs = _pairs(model, np.flatnonzero(is_wall))
        shapes = {int(kind) for kind in model.geom_type[pairs[:, 1]]}
        if (has_record[pairs[:, 1]] & (model.geom_type[pairs[:, 1]] == CAPSULE)).any():
            shapes.add(LINE)
            if LINE_PREVIOUS not in entered:
                problem = (
                    "has rows of lugs: build it in this process, by ot.Simulation of its robot"
                )
                raise InputError(Fault("model", problem))
        _check(model, pairs)
        numbers = {int(number) for number in rows[is_wall, KIND] if number > PLATE}
        self.pairs = pairs
        uneven = {int(number) for number in rows[is_wall & (rows[:, LONG] > 0), KIND]}
        self._find = _finder(_kinds(numbers), tuple(sorted(shapes)), _kinds(uneven))
        self._set_arrays(model, is_wall)

    def _set_arrays(self, model: mujoco.MjModel, is_wall: NDArray[np.bool_]) -> None:
        """Bring what does not change to the device."""
        fields = model.geom_dataid[self.pairs[:, 0]]
        size = model.hfield_size[fields]
        half = np.stack([size[:, 0], size[:, 1], np.maximum(size[:, 2], size[:, 3])], axis=1)
        self._pairs = wp.array(self.pairs, dtype=wp.vec2i)
        self._half_sizes = wp.array(half, dtype=wp.vec3)
        self._fields = kernels.Fields()
        self._fields.user_size = model.nuser_geom
        integers = {
            "types": model.geom_type,
            "data_ids": model.geom_dataid,
            "vertices_at": model.mesh_vertadr,
            "vertex_count": model.mesh_vertnum,
            "polygons_of": model.mesh_polymapnum,
            "polygons_at": model.mesh_polyadr,
            "polygon_count": model.mesh_polynum,
            "polygon_begins": model.mesh_polyvertadr,
            "polygon_sizes": model.mesh_polyvertnum,
            "polygon_vertices": model.mesh_polyvert,
        }
        numbers = {
            "records": _records(model, is_wall),
            "vertices": model.mesh_vert,
            "polygon_normals": model.mesh_polynormal,
        }
        for fields, kind in ((integers, int), (numbers, float)):
            for name, values in fields.items():
                setattr(self._fields, name, wp.array(_some(values), dtype=kind))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        is_still = model.body_weldid[model.geom_bodyid] == 0
        still = np.flatnonzero(is_still)
        self._still = wp.array(still, dtype=int)
        self._places = wp.array(data.geom_xpos[still], dtype=wp.vec3d)
        self.origins: Any = None
        self._max_near = _max_near(self.pairs, data.geom_xpos, half, model)
        roots = np.flatnonzero(model.jnt_bodyid == model.body_rootid[model.jnt_bodyid])
        is_free = model.jnt_type[roots] == mujoco.mjtJoint.mjJNT_FREE
        places = model.jnt_qposadr[roots]
        self.free = wp.array(places, dtype=int) if is_free.all() and is_free.size else None
        self._work: dict[tuple[int, int], Work] = {}

    def __call__(self, m: mjw.Model, d: mjw.Data) -> None:
        """Append the contacts of all worlds with the walls, as MuJoCo Warp asks for it."""
        work, fields = self.work(d), self._fields_of(m, d)
        work.near_count.zero_()
        work.found.count.zero_()
        if self.origins is not None:
            places = [self._still, self._places, self.origins, d.geom_xpos]
            wp.launch(kernels.place_walls, (d.nworld, len(self._still)), inputs=places)
        wp.launch(
            kernels.near_pairs,
            (d.nworld, len(self.pairs)),
            inputs=[self._pairs, self._half_sizes, fields],
            outputs=[work.near, work.near_count],
        )
        inputs = [work.near, work.near_count, self._pairs, fields]
        wp.launch(self._find, len(work.near), inputs=inputs, outputs=[work.found])
        wp.launch(
            kernels.add_contacts,
            d.naconmax,
            inputs=[*(getattr(m, name) for name in CONTACT_PARAMETERS), work.found, d.naconmax],
            outputs=[*(getattr(d.contact, name) for name in CONTACT_FIELDS), d.nacon],
        )

    def _fields_of(self, m: mjw.Model, d: mjw.Data) -> Any:
        """Return what finding contacts reads; a model's arrays may have been replaced."""
        fields = self._fields
        fields.priorities, fields.sizes, fields.bounds = m.geom_priority, m.geom_size, m.geom_rbound
        fields.solmix, fields.solref = m.geom_solmix, m.geom_solref
        fields.margins, fields.gaps = m.geom_margin, m.geom_gap
        fields.positions, fields.matrices = d.geom_xpos, d.geom_xmat
        return fields

    def work(self, d: mjw.Data) -> Work:
        """Return the arrays for some data; those of the same size share them."""
        key = d.nworld, d.naconmax
        if key not in self._work:
            near = d.nworld * self._max_near
            found = kernels.Found()
            found.numbers = wp.zeros((d.naconmax, CONTACT_SIZE), dtype=float)
            found.geoms = wp.zeros(d.naconmax, dtype=wp.vec2i)
            found.worlds, found.count = wp.zeros(d.naconmax, dtype=int), wp.zeros(1, dtype=int)
            near_pairs = wp.zeros(near, dtype=wp.vec2i)
            self._work[key] = Work(near_pairs, wp.zeros(1, dtype=int), found)
        return self._work[key]


def put_model(model: mujoco.MjModel, **options: Any) -> mjw.Model:
    """Put a model with exact walls onto the device, as ``mujoco_warp.put_model`` does.

    In ``mujoco_warp.step`` the walls then act on every world.

    Args:
        model: compiled of a spec that ``add_pipes`` has given its walls.
        options: those of ``mujoco_warp.put_model``.

    Raises:
        InputError: the model has no exact walls, or a geom that they cannot touch on a device.
        NotImplementedError: MuJoCo Warp does not know something else of the model.
    """
    walls = Walls(model)
    m = mjw.put_model(_without_guard(model), **options)
    m.callback.contactfilter = walls
    return m


def _without_guard(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model that MuJoCo Warp takes: without the guard's plugin, its walls untouchable."""
    model = copy.copy(model)
    guard = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_PLUGIN, PLUGIN)
    sensors = model.sensor_plugin == guard
    # A user's sensor without values is never computed.
    model.sensor_plugin[sensors], model.sensor_type[sensors] = -1, mujoco.mjtSensor.mjSENS_USER
    walls = np.flatnonzero(model.geom_type == _FIELD)
    # MuJoCo Warp counts on each plugin being that of a geom; of height fields it asks for none.
    model.geom_plugin[walls[0]] = guard
    # MuJoCo Warp would take a wall for the box of its height field.
    model.geom_contype[walls] = model.geom_conaffinity[walls] = 0
    return model


def _pairs(model: mujoco.MjModel, walls: NDArray[Any]) -> NDArray[Any]:
    """Return the numbers (n, 2) of walls and geoms that MuJoCo would have touch each other."""
    welds, pairs = model.body_weldid[model.geom_bodyid], []
    parents = model.body_weldid[model.body_parentid[welds]]
    excluded = set(model.exclude_signature.tolist())
    filters = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    others = np.flatnonzero(model.geom_type > _FIELD)
    for wall in walls:
        touches = (model.geom_contype[wall] & model.geom_conaffinity[others]) | (
            model.geom_contype[others] & model.geom_conaffinity[wall]
        )
        for geom in others[touches != 0]:
            one, other = welds[wall], welds[geom]
            is_parent = one and other and (one == parents[geom] or other == parents[wall])
            bodies = sorted(model.geom_bodyid[[wall, geom]])
            is_excluded = (int(bodies[0]) << 16) + int(bodies[1]) in excluded
            if one != other and not (filters and is_parent) and not is_excluded:
                pairs.append((wall, geom))
    return np.array(pairs, int).reshape(-1, 2)


def _check(model: mujoco.MjModel, pairs: NDArray[Any]) -> None:
    """Refuse what walls cannot touch on a device."""
    known = {SPHERE, *SHAPES}
    faults = []
    for geom in sorted(set(pairs[:, 1].tolist())):
        kind, name = int(model.geom_type[geom]), model.geom(geom).name or geom
        if kind not in known:
            what = mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_").lower()
            faults.append(Fault(f"model.geoms.{name}", f"is a {what}, which walls cannot touch"))
    if faults:
        raise InputError(faults)


def _max_near(
    pairs: NDArray[Any], places: NDArray[Any], half: NDArray[Any], model: mujoco.MjModel
) -> int:
    """Return how many pairs of one world can be near each other at once, at most.

    Walls near the same geom are near each other.

    Args:
        pairs: see ``Walls``.
        places: (geoms, 3) m.
        half: (n, 3) m, half sizes of the box around the wall of each pair.
        model: of the geoms.
    """
    walls, first = np.unique(pairs[:, 0], return_index=True)
    geoms = np.unique(pairs[:, 1])
    if model.body_weldid[model.geom_bodyid[walls]].any():
        return len(pairs)  # walls that move may come near others
    reach = (model.geom_margin + model.geom_gap)[walls].max(initial=0.0)
    each = model.geom_rbound + model.geom_margin + model.geom_gap
    most = 2 * (each[geoms].max(initial=0.0) + reach)
    radius, place = np.linalg.norm(half[first], axis=1), places[walls]
    near = [
        np.count_nonzero(np.linalg.norm(place - at, axis=1) <= radius + own + most)
        for at, own in zip(place, radius, strict=True)
    ]
    return min(len(pairs), len(geoms) * int(max(near, default=0)))


def _kinds(numbers: Collection[int]) -> tuple[WallKind, ...]:
    """Return what the numbers of kinds stand for in this process, in one order."""
    names = [kinds.names[number] for number in numbers]
    other = {Obstacle.file_kind(): Obstacle}
    return tuple(sorted((other.get(name) or fitting_class(name) for name in names), key=str))


def _records(model: mujoco.MjModel, is_wall: NDArray[np.bool_]) -> NDArray[Any]:
    """Return the records of all geoms, and behind them the long sizes of walls with relief.

    In a record is then where they begin, and in the sizes the number of the wall's kind.
    """
    records, more = np.array(model.geom_user, float), []
    for geom in np.flatnonzero(is_wall):
        own = records[geom, -RECORD_SIZE:]
        if own[LONG] > 0:
            kept = long_sizes.numbers((int(own[SIZES]), int(own[SIZES + 1])))
            if kept is None:
                problem = "has relief: build it in this process, by ot.add_pipes"
                raise InputError(Fault("model", problem))
            sizes = kept.copy()
            sizes[ADDRESS], own[SIZES] = own[KIND], records.size + sum(map(len, more))
            more.append(sizes)
    whole = np.concatenate([records.ravel(), *more])
    if len(whole) > MAX_NUMBERS:
        raise InputError(Fault("model", "has relief of too many numbers for single precision"))
    return whole


def _some(values: NDArray[Any]) -> NDArray[Any]:
    """Return flat values, at least one: Warp has no pointer to none."""
    return values.ravel() if values.size else np.zeros(1, values.dtype)


@cache
def _finder(
    fittings: Collection[WallKind], shapes: Collection[int], uneven: Collection[WallKind]
) -> Any:
    """Return the kernel that finds the contacts of pairs; see ``contacts.translation``."""
    snippet = f"""{structure(fittings, shapes, uneven)}
    Walls::Model model;
    model.USER_SIZE = fields.user_size;
    model.USER = fields.records.data;
    model.TYPE = fields.types.data;
    model.DATA_ID = fields.data_ids.data;
    model.VERTICES_AT = fields.vertices_at.data;
    model.VERTEX_COUNT = fields.vertex_count.data;
    model.VERTICES = fields.vertices.data;
    model.POLYGONS_OF = fields.polygons_of.data;
    model.POLYGONS_AT = fields.polygons_at.data;
    model.POLYGON_COUNT = fields.polygon_count.data;
    model.POLYGON_BEGINS = fields.polygon_begins.data;
    model.POLYGON_SIZES = fields.polygon_sizes.data;
    model.POLYGON_VERTICES = fields.polygon_vertices.data;
    model.POLYGON_NORMALS = fields.polygon_normals.data;
    model.PRIORITY = fields.priorities.data;
    model.SIZE = (float*)&wp::index(fields.sizes, world % fields.sizes.shape[0], 0);
    model.BOUND = (float*)&wp::index(fields.bounds, world % fields.bounds.shape[0], 0);
    model.SOLMIX = (float*)&wp::index(fields.solmix, world % fields.solmix.shape[0], 0);
    model.SOLREF = (float*)&wp::index(fields.solref, world % fields.solref.shape[0], 0);
    model.POSITIONS = (float*)&wp::index(fields.positions, world, 0);
    model.MATRICES = (float*)&wp::index(fields.matrices, world, 0);
    float con[{room(fittings, shapes)}];
    const int n = Walls::contacts(model, con, wall, geom, margin);
    if (n == 0)
      return;
    const int first = wp::atomic_add(found.count.data, n);
    for (int i = 0; i < n && first + i < found.numbers.shape[0]; ++i) {{
      for (int j = 0; j < {CONTACT_SIZE}; ++j)
        wp::index(found.numbers, first + i, j) = con[{CONTACT_SIZE} * i + j];
      found.geoms.data[first + i] = wp::vec_t<2, wp::int32>(wall, geom);
      found.worlds.data[first + i] = world;
    }}
"""

    @wp.func_native(snippet)
    def find(
        fields: kernels.Fields,
        world: int,
        wall: int,
        geom: int,
        margin: float,
        found: kernels.Found,
    ): ...

    @wp.kernel(enable_backward=False, module="unique")
    def find_contacts(
        near: wp.array(dtype=wp.vec2i),
        near_count: wp.array(dtype=int),
        pairs: wp.array(dtype=wp.vec2i),
        fields: kernels.Fields,
        found: kernels.Found,
    ):
        i = wp.tid()
        if i >= wp.min(near_count[0], near.shape[0]):
            return
        world, pair = near[i][0], pairs[near[i][1]]
        wall, geom = pair[0], pair[1]
        margin = kernels.reach_of(fields, world, wall, geom)
        find(fields, world, wall, geom, margin, found)

    return find_contacts
