"""Solid pipe fittings as triangle meshes, for pictures and export. Collision never uses them.

Each fitting is (outer solids together) - (bores together): uniting finished pipe *shells* instead
would leave the wall of the run across the mouth of the branch. The genus distinguishes the two:
openings - 1 when every bore is open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh, OpType
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Assembly, Fitting, Part
from omnitrack_sim.pipes.sections import Section

THICKNESS = 0.004
"""Wall thickness of every fitting, m: a 168 mm pipe with a 160 mm bore; assumed."""
SECTIONS = 96
"""Corners of a pipe's cross-section."""
DEGREES_PER_RING = 3.75
"""Bend angle between neighbouring cross-sections of an elbow, degrees."""
OVERCUT = 2e-4
"""Depth to which cutting solids reach into what is already empty, m."""
JOINT_DISC = 1e-3
"""Half the depth of the discs that unite neighbouring parts, m: as much as a loop may miss."""


class TriangleMesh(NamedTuple):
    """A surface of triangles, as ``trimesh.Trimesh(*mesh, process=False)`` takes it.

    trimesh is imported for exports alone: that takes half a second.

    Attributes:
        vertices: (n, 3) m.
        faces: (m, 3) indices of vertices, anticlockwise as seen from outside.
    """

    vertices: Array
    faces: NDArray[np.int64]

    @property
    def volume(self) -> float:
        """Volume inside, m³; negative where the faces look inward."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        return float((a * np.cross(b, c)).sum() / 6)

    @property
    def face_normals(self) -> Array:
        """Unit normals (m, 3) of the faces; zero where a face has no area."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        normals = np.cross(b - a, c - a)
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    def outward(self) -> TriangleMesh:
        """The same surface with its faces looking outward."""
        return self if self.volume >= 0 else TriangleMesh(self.vertices, self.faces[:, ::-1])


def fitting_mesh(
    fitting: Fitting, thickness: float = THICKNESS, sections: int = SECTIONS
) -> TriangleMesh:
    """Return the wall of a fitting as a watertight solid of genus openings - 1, m, fitting frame.

    The bore is inscribed: corners lie on the exact surface, faces up to R (1 - cos(pi / sections))
    inside it.
    """
    return triangles_of(_wall(fitting, thickness, sections))


def network_mesh(network: Assembly) -> TriangleMesh:
    """Return the walls of a network as one watertight solid, m, world frame, open at open ends.

    Parts touch in a plane only, which rounding may leave as a gap: a disc across each joint unites
    them.
    """
    outer, bores = [], []
    for part in network.parts:
        fitting, matrix = part.fitting, np.column_stack([part.pose.rotation, part.pose.position])
        outer.append(_fill(fitting, THICKNESS, SECTIONS).transform(matrix))
        bores.append(_bore(fitting, SECTIONS).transform(matrix))
    for (i, port), (j, other) in network.joints:
        # A disc lies in the plane of the joint, which both parts share.
        place = network.parts[i].port(port)
        matrix = np.column_stack([place.rotation, place.position])
        ends = (network.parts[i], port), (network.parts[j], other)
        for solids, more in ((outer, THICKNESS), (bores, 0.0)):
            solids.append(_joint_disc(*ends, more, SECTIONS).transform(matrix))
    # A bore ends flush with its wall: at an open end it is cut a little beyond, or a film may stay.
    for i, port in network.openings:
        place, radius = network.parts[i].port(port), network.parts[i].fitting.port_radius(port)
        matrix = np.column_stack([place.rotation, place.position])
        edge = network.parts[i].fitting.edge(port)
        disc = _disc(OVERCUT, radius, edge, 0.0, SECTIONS)
        bores.append(disc.transform(matrix))
    return triangles_of(
        Manifold.batch_boolean(outer, OpType.Add) - Manifold.batch_boolean(bores, OpType.Add)
    )


def cutaway_mesh(
    fitting: Fitting,
    towards: ArrayLike,
    sections: int = SECTIONS,
    keep: bool = True,
) -> TriangleMesh:
    """Return half of a fitting, so that one looks into the bore.

    The half that faces ``towards`` is taken away.

    Args:
        fitting: what to cut.
        towards: (3,) direction of the viewer in the fitting frame. Fittings that bend or branch
            are cut along their own plane, on the viewer's side; axial ones along their axis.
        sections: corners of the cross-section.
        keep: True for the half that stays, False for the one taken away.
    """
    return _half(_wall(fitting, THICKNESS, sections), fitting, towards, keep)


def inside_mesh(fitting: Fitting, sections: int = SECTIONS) -> TriangleMesh:
    """Return the inner surface of a fitting alone, m, fitting frame.

    Its faces look into the bore.
    """
    return _inside(fitting_mesh(fitting, sections=sections), fitting)


def opened_meshes(
    fitting: Fitting, towards: ArrayLike, sections: int = SECTIONS
) -> tuple[TriangleMesh, TriangleMesh, TriangleMesh]:
    """Return both halves of a fitting that is cut open, and its inner surface.

    As ``cutaway_mesh`` with and without ``keep`` and ``inside_mesh``, of a wall that is made once.
    """
    wall = _wall(fitting, THICKNESS, sections)
    kept, front = (_half(wall, fitting, towards, keep) for keep in (True, False))
    return kept, front, _inside(triangles_of(wall), fitting)


def _half(wall: Manifold, fitting: Fitting, towards: ArrayLike, keep: bool) -> TriangleMesh:
    """Return the half of a fitting's wall that stays, or the one that faces the viewer."""
    side = np.asarray(cut_normal(fitting, towards)) * (-1.0 if keep else 1.0)
    return triangles_of(wall.trim_by_plane(tuple(side), 0.0))


def _inside(wall: TriangleMesh, fitting: Fitting) -> TriangleMesh:
    """Return the inner surface of a fitting's wall."""
    # Half of the wall's thickness separates the inner surface from the outer one and survives the
    # inscribed bore's error.
    vertices, faces = wall
    within = fitting.signed_distance(vertices)[0] > -THICKNESS / 2
    kept, faces = np.unique(faces[within[faces].all(axis=1)], return_inverse=True)
    return TriangleMesh(vertices[kept], faces.reshape(-1, 3))


def cut_normal(fitting: Fitting, towards: ArrayLike) -> Array:
    """Unit normal (3,), fitting frame, of the cut through the fitting's axis, towards the viewer.

    ``towards``: (3,), to the viewer.
    """
    x, y, _ = np.asarray(towards, float)
    if not fitting.is_axial:
        # Fittings that are not axial are symmetric about y = 0, the only plane that shows all axes.
        return np.array([0.0, math.copysign(1.0, y), 0.0])
    across = np.array([x, y, 0.0])
    length = float(np.linalg.norm(across))
    return across / length if length > 1e-6 else np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class ManifoldKit:
    """``pipes.shapes.Kit`` with the solids of manifold3d."""

    sections: int
    overcut: float = OVERCUT

    def cylinder(
        self,
        length: float,
        radius: float,
        end_radius: float | None = None,
        *,
        centred: bool = False,
    ) -> Manifold:
        """See ``Kit``."""
        end = radius if end_radius is None else end_radius
        sections = self.sections
        return Manifold.cylinder(length, radius, end, circular_segments=sections, center=centred)

    def prism(self, length: float, outline: Array) -> Manifold:
        """See ``Kit``."""
        return Manifold.extrude(CrossSection([outline]), length)

    def revolved(self, outline: Array) -> Manifold:
        """See ``Kit``."""
        return Manifold.revolve(CrossSection([outline]), circular_segments=self.sections)

    def bend(self, mean_radius: float, angle: float, radius: float) -> Manifold:
        """See ``Kit``."""
        disc = CrossSection.circle(radius, self.sections).translate((mean_radius, 0.0))
        degrees = math.degrees(angle)
        steps = max(3, math.ceil(degrees / DEGREES_PER_RING))
        sector = Manifold.revolve(disc, circular_segments=steps, revolve_degrees=degrees)
        # revolve() sweeps from +x towards +y about z; a bend from -x towards +z about y.
        return sector.transform(
            np.array([[-1, 0, 0, mean_radius], [0, 0, 1, 0], [0, 1, 0, 0]], float)
        )

    def loft(self, rings: Array, hub: int | None) -> Manifold:
        """See ``Kit``."""
        # The order of the rings decides which way the faces look; the kernel needs them outward.
        vertices, faces = TriangleMesh(*loft(rings, hub)).outward()
        return Manifold(Mesh(vertices.astype(np.float32), faces.astype(np.uint32)))

    def moved(self, solid: Manifold, pose: Pose) -> Manifold:
        """See ``Kit``."""
        return solid.transform(np.column_stack([pose.rotation, pose.position]))


def _wall(fitting: Fitting, thickness: float, sections: int) -> Manifold:
    # The bore is made first: the order of making solids orders the triangles of the result.
    bore = _bore(fitting, sections)
    return _fill(fitting, thickness, sections) - bore


def _bore(fitting: Fitting, sections: int) -> Manifold:
    return cast(Manifold, fitting.bore(ManifoldKit(sections)))


def _fill(fitting: Fitting, thickness: float, sections: int) -> Manifold:
    return cast(Manifold, fitting.fill(ManifoldKit(sections), thickness))


def _joint_disc(a: tuple[Part, str], b: tuple[Part, str], more: float, sections: int) -> Manifold:
    """Return a solid about the joint of two ports that fills both bores and ``more`` m around them.

    In the frame of the first port.
    """
    edge = a[0].fitting.edge(a[1])
    radii = [part.fitting.port_radius(port) for part, port in (a, b)]
    radius = min(radii) if more == 0 else max(radii)
    behind, ahead = (radius + JOINT_DISC * part.fitting.flare(port) for part, port in (a, b))
    # Without a cone or a step the disc is a plain cylinder, which the kernel makes exactly.
    if behind == ahead == radius:
        return _disc(JOINT_DISC, radius, edge, more, sections)
    across = [0.0, behind + more, radius + more, ahead + more, 0.0]
    along = JOINT_DISC * np.array([-1.0, -1.0, 0.0, 1.0, 1.0])
    return Manifold.revolve(
        CrossSection([np.column_stack([across, along])]), circular_segments=sections
    )


def section_plate(edge: Section, thickness: float) -> TriangleMesh:
    """Return a plate in the shape of a bore, ``thickness`` m, about the plane z = 0."""
    return triangles_of(_disc(thickness / 2, edge.size / 2, edge, 0.0, SECTIONS))


def _disc(half: float, radius: float, edge: Section | None, more: float, sections: int) -> Manifold:
    """Return a disc of a bore and ``more`` m around it, ``half`` m to both sides of z = 0."""
    if edge is None:
        return Manifold.cylinder(2 * half, radius + more, circular_segments=sections, center=True)
    outline = CrossSection([edge.polygon(sections, more)])
    return Manifold.extrude(outline, 2 * half).translate((0.0, 0.0, -half))


def loft(rings: Array, hub: int | None) -> tuple[Array, np.ndarray]:
    """Return vertices and faces of the solid through closed rings (m, k, 3).

    Fans over both ends meet at their corner ``hub``; without a hub the last ring is joined to the
    first.
    """
    count, corners, _ = rings.shape
    index = np.arange(count * corners).reshape(count, corners)
    a, b = (index[:-1], index[1:]) if hub is not None else (index, np.roll(index, -1, axis=0))
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [np.stack([a, a_next, b], -1), np.stack([a_next, b_next, b], -1)]
    faces = [triangles.reshape(-1, 3) for triangles in faces]
    if hub is not None:
        # Cross-sections are not convex; seen from their hub every corner is visible.
        fan = [(hub, (hub + i) % corners, (hub + i + 1) % corners) for i in range(1, corners - 1)]
        faces += [index[0][np.array(fan)][:, ::-1], index[-1][np.array(fan)]]
    return rings.reshape(-1, 3), np.concatenate(faces)


def stl_bytes(mesh: TriangleMesh) -> bytes:
    """Return a mesh as a binary STL file."""
    import trimesh  # half a second, and only exports need it

    return trimesh.exchange.stl.export_stl(trimesh.Trimesh(*mesh, process=False))


def triangles_of(solid: Manifold) -> TriangleMesh:
    """Vertices and faces of a solid, in the order of the boolean kernel."""
    mesh = solid.to_mesh()
    return TriangleMesh(
        np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts, np.int64)
    )
