"""Kernels of the contacts with exact walls: pairs that are near, their contacts, MuJoCo's rows."""

import warp as wp
from mujoco_warp._src.collision_core import (
    contact_margin_gap,
    contact_material_params,
    write_contact,
)
from mujoco_warp._src.types import vec5

wp.set_module_options({"enable_backward": False})


@wp.struct
class Fields:
    """What finding contacts reads of a model and of the worlds, see ``walls.collider``."""

    user_size: int
    records: wp.array(dtype=float)
    types: wp.array(dtype=int)
    data_ids: wp.array(dtype=int)
    vertices_at: wp.array(dtype=int)
    vertex_count: wp.array(dtype=int)
    polygons_of: wp.array(dtype=int)
    polygons_at: wp.array(dtype=int)
    polygon_count: wp.array(dtype=int)
    polygon_begins: wp.array(dtype=int)
    polygon_sizes: wp.array(dtype=int)
    polygon_vertices: wp.array(dtype=int)
    vertices: wp.array(dtype=float)
    polygon_normals: wp.array(dtype=float)
    priorities: wp.array(dtype=int)
    sizes: wp.array2d(dtype=wp.vec3)
    bounds: wp.array2d(dtype=float)
    solmix: wp.array2d(dtype=float)
    solref: wp.array2d(dtype=wp.vec2)
    margins: wp.array2d(dtype=float)
    gaps: wp.array2d(dtype=float)
    positions: wp.array2d(dtype=wp.vec3)
    matrices: wp.array2d(dtype=wp.mat33)


@wp.struct
class Found:
    """Contacts that were found: numbers, geoms with the wall first, worlds, and how many."""

    numbers: wp.array2d(dtype=float)
    geoms: wp.array(dtype=wp.vec2i)
    worlds: wp.array(dtype=int)
    count: wp.array(dtype=int)


@wp.func
def reach_of(fields: Fields, world: int, wall: int, geom: int) -> float:
    """Return the distance, m, up to which contacts of two geoms count."""
    m, g = world % fields.margins.shape[0], world % fields.gaps.shape[0]
    margin = fields.margins[m, wall] + fields.margins[m, geom]
    return margin + fields.gaps[g, wall] + fields.gaps[g, geom]


@wp.kernel
def place_walls(
    still: wp.array(dtype=int),
    places: wp.array(dtype=wp.vec3d),
    origins: wp.array(dtype=wp.vec3d),
    geom_xpos: wp.array2d(dtype=wp.vec3),
):
    """Write the positions of geoms that do not move, from each world's own origin."""
    world, i = wp.tid()
    place = places[i] - origins[world % origins.shape[0]]
    geom_xpos[world, still[i]] = wp.vec3(float(place[0]), float(place[1]), float(place[2]))


@wp.kernel
def near_pairs(
    pairs: wp.array(dtype=wp.vec2i),
    half_sizes: wp.array(dtype=wp.vec3),
    fields: Fields,
    near: wp.array(dtype=wp.vec2i),
    count: wp.array(dtype=int),
):
    """List the pairs whose geom's bounding ball reaches the box around the wall."""
    world, i = wp.tid()
    wall, geom = pairs[i][0], pairs[i][1]
    reach = fields.bounds[world % fields.bounds.shape[0], geom]
    reach += reach_of(fields, world, wall, geom)
    apart = fields.positions[world, geom] - fields.positions[world, wall]
    half = half_sizes[i]
    farthest = wp.length(half) + reach
    if wp.length_sq(apart) > farthest * farthest:
        return
    within = wp.transpose(fields.matrices[world, wall]) * apart
    beyond = wp.vec3(
        wp.max(wp.abs(within[0]) - half[0], 0.0),
        wp.max(wp.abs(within[1]) - half[1], 0.0),
        wp.max(wp.abs(within[2]) - half[2], 0.0),
    )
    if wp.length_sq(beyond) <= reach * reach:
        place = wp.atomic_add(count, 0, 1)
        if place < near.shape[0]:
            near[place] = wp.vec2i(world, i)


@wp.func
def frame_of(normal: wp.vec3, tangent: wp.vec3) -> wp.mat33:
    """Return a contact's frame by rows, as MuJoCo makes it of a normal and a tangent or none."""
    x = wp.normalize(normal)
    y = tangent
    if wp.length_sq(y) < 0.25:
        y = wp.vec3(0.0, 0.0, 1.0)
        if wp.abs(x[1]) < 0.5:
            y = wp.vec3(0.0, 1.0, 0.0)
    y = wp.normalize(y - wp.dot(x, y) * x)
    z = wp.cross(x, y)
    return wp.mat33(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])


@wp.kernel
def add_contacts(
    geom_condim: wp.array(dtype=int),
    geom_priority: wp.array(dtype=int),
    geom_solmix: wp.array2d(dtype=float),
    geom_solref: wp.array2d(dtype=wp.vec2),
    geom_solimp: wp.array2d(dtype=vec5),
    geom_friction: wp.array2d(dtype=wp.vec3),
    geom_margin: wp.array2d(dtype=float),
    geom_gap: wp.array2d(dtype=float),
    geom_adhesion: wp.array2d(dtype=float),
    pair_dim: wp.array(dtype=int),
    pair_solref: wp.array2d(dtype=wp.vec2),
    pair_solreffriction: wp.array2d(dtype=wp.vec2),
    pair_solimp: wp.array2d(dtype=vec5),
    pair_margin: wp.array2d(dtype=float),
    pair_gap: wp.array2d(dtype=float),
    pair_adhesion: wp.array2d(dtype=float),
    pair_friction: wp.array2d(dtype=vec5),
    found: Found,
    naconmax: int,
    contact_dist: wp.array(dtype=float),
    contact_pos: wp.array(dtype=wp.vec3),
    contact_frame: wp.array(dtype=wp.mat33),
    contact_includemargin: wp.array(dtype=float),
    contact_friction: wp.array(dtype=vec5),
    contact_solref: wp.array(dtype=wp.vec2),
    contact_solreffriction: wp.array(dtype=wp.vec2),
    contact_solimp: wp.array(dtype=vec5),
    contact_dim: wp.array(dtype=int),
    contact_geom: wp.array(dtype=wp.vec2i),
    contact_efc_address: wp.array2d(dtype=int),
    contact_worldid: wp.array(dtype=int),
    contact_type: wp.array(dtype=int),
    contact_geomcollisionid: wp.array(dtype=int),
    contact_adhesion: wp.array(dtype=float),
    nacon: wp.array(dtype=int),
):
    """Append the contacts that were found to those of MuJoCo, with what both geoms say of them."""
    i = wp.tid()
    room = found.numbers.shape[0]
    if i == 0 and found.count[0] > room:
        # Of more contacts than there is room for MuJoCo Warp warns.
        wp.atomic_add(nacon, 0, found.count[0] - room)
    if i >= wp.min(found.count[0], room):
        return
    geoms, world = found.geoms[i], found.worlds[i]
    margin, gap = contact_margin_gap(geom_margin, geom_gap, pair_margin, pair_gap, geoms, -1, world)
    condim, friction, solref, solreffriction, solimp, adhesion = contact_material_params(
        geom_condim,
        geom_priority,
        geom_solmix,
        geom_solref,
        geom_solimp,
        geom_friction,
        geom_adhesion,
        pair_dim,
        pair_solref,
        pair_solreffriction,
        pair_solimp,
        pair_adhesion,
        pair_friction,
        geoms,
        -1,
        world,
    )
    frame = frame_of(
        wp.vec3(found.numbers[i, 4], found.numbers[i, 5], found.numbers[i, 6]),
        wp.vec3(found.numbers[i, 7], found.numbers[i, 8], found.numbers[i, 9]),
    )
    write_contact(
        naconmax,
        0,
        found.numbers[i, 0],
        wp.vec3(found.numbers[i, 1], found.numbers[i, 2], found.numbers[i, 3]),
        frame,
        margin,
        gap,
        condim,
        friction,
        solref,
        solreffriction,
        solimp,
        adhesion,
        geoms,
        wp.vec2i(-1, -1),
        world,
        contact_dist,
        contact_pos,
        contact_frame,
        contact_includemargin,
        contact_friction,
        contact_solref,
        contact_solreffriction,
        contact_solimp,
        contact_dim,
        contact_geom,
        contact_efc_address,
        contact_worldid,
        contact_type,
        contact_geomcollisionid,
        contact_adhesion,
        nacon,
    )
