"""A run as MCAP, which Foxglove and Rerun open: poses, joints, contacts, channels, shapes.

Messages are those of Foxglove's schemas, and for channels and contacts plain ones of this package,
all in protobuf, whose descriptions stand in the file.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import strict_json
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.events import Note
from omnitrack_sim.results.dataset import PHASE, labels_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.plant import PIPES
from omnitrack_sim.robots.recorded import Recorded
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.sources import playback_of
from omnitrack_sim.show.surfaces import Surface, geoms_surface, pipe_inside

WORLD = "world"
"""Frame of the pipes; those of bodies have the bodies' names."""
PIPE_ALPHA = 0.25
"""Opacity of the pipes, through which the robot is seen."""
_NAME = re.compile(r"\W")


def to_mcap(result: Result) -> bytes:
    """Return a run as the bytes of an MCAP file; equal runs give equal bytes.

    A run that was read without trust, whose robot is only known by its pictures, has no contacts.

    Raises:
        ImportError: the extra ``mcap`` is not installed.
        RenderError: the run has no pose that can be shown.
    """
    file = _File()
    playback = playback_of(result, coarse=False)
    times = [round(1e9 * time) for time in result.trajectory.time.tolist()]  # ns
    _add_shapes(file, playback, times[0])
    _add_poses(file, playback, result, times)
    _add_joints(file, result, times)
    if not isinstance(result.scenario.robot, Recorded):
        _add_contacts(file, result, times)
    for name, channel in result.trajectory.schema.items():
        _add_channel(file, result, name, channel, times)
    _add_events(file, result)
    return file.finished(result)


def _add_shapes(file: _File, playback: Playback, time: int) -> None:
    """Add the pipes, and what is seen of each body in the body's frame, once."""
    model, scene = playback.model, file.foxglove("SceneUpdate")
    pipes = [pipe_inside(part.fitting).placed(part.pose) for part in playback.network.parts]
    pipes += [geoms_surface(model, [plate]) for plate in playback.still]
    entity = _entity(scene, "pipes", WORLD, time)
    _add_triangles(entity, Surface.joined(pipes), PIPE_ALPHA)
    bodies = model.geom_bodyid[list(playback.moving)]
    for body in dict.fromkeys(bodies.tolist()):
        geoms = [g for g, b in zip(playback.moving, bodies, strict=True) if b == body]
        entity = _entity(scene, _body(model, body), _body(model, body), time)
        _add_triangles(entity, geoms_surface(model, geoms, fine=True), 1.0)
    file.add("/scene", scene, time)


def _entity(scene: Any, name: str, frame: str, time: int) -> Any:
    entity = scene.entities.add(id=name, frame_id=frame, frame_locked=True)
    entity.timestamp.FromNanoseconds(time)
    return entity


def _add_triangles(entity: Any, surface: Surface, alpha: float) -> None:
    """Add the triangles of a surface to an entity, those of each colour as one list."""
    colours, of = np.unique(surface.colour[:, :3], axis=0, return_inverse=True)
    for i, (red, green, blue) in enumerate(colours.tolist()):
        faces = surface.faces[of.ravel()[surface.faces[:, 0]] == i]
        used, indices = np.unique(faces, return_inverse=True)
        triangles = entity.triangles.add()
        triangles.pose.orientation.w = 1.0
        for name, value in zip("rgba", (red, green, blue, alpha), strict=True):
            setattr(triangles.color, name, value)
        for x, y, z in surface.position[used].tolist():
            triangles.points.add(x=x, y=y, z=z)
        triangles.indices.extend(indices.ravel().tolist())


def _add_poses(file: _File, playback: Playback, result: Result, times: Sequence[int]) -> None:
    """Add the frame of each body, and that of the robot, at each sample."""
    model = playback.model
    bodies = range(1, model.nbody)
    names = [_body(model, body) for body in bodies]
    for time, row in zip(times, playback.body_poses(bodies), strict=True):
        frames = file.foxglove("FrameTransforms")
        for name, pose in zip(names, row, strict=True):
            frame = frames.transforms.add(parent_frame_id=WORLD, child_frame_id=name)
            frame.timestamp.FromNanoseconds(time)
            _put_pose(frame.translation, frame.rotation, pose)
        file.add("/tf", frames, time)
    poses = np.hstack([result.trajectory["position"], result.trajectory["quaternion"]])
    for time, own in zip(times, poses, strict=True):
        pose = file.foxglove("PoseInFrame")
        pose.frame_id = WORLD
        pose.timestamp.FromNanoseconds(time)
        _put_pose(pose.pose.position, pose.pose.orientation, own)
        file.add("/pose", pose, time)


def _put_pose(position: Any, orientation: Any, pose: Array) -> None:
    """Write position and quaternion (w, x, y, z), (7,), into a message's parts."""
    position.x, position.y, position.z, w, x, y, z = pose.tolist()
    orientation.w, orientation.x, orientation.y, orientation.z = w, x, y, z


def _add_joints(file: _File, result: Result, times: Sequence[int]) -> None:
    """Add the positions of slides and hinges, m and rad; other joints are in the poses."""
    joints = result.joints.items()
    own = [(columns.start, name) for name, columns in joints if columns.stop - columns.start == 1]
    for time, row in zip(times, result.qpos.tolist(), strict=True):
        states = file.foxglove("JointStates")
        states.timestamp.FromNanoseconds(time)
        for i, name in own:
            states.joints.add(name=name, position=row[i])
        file.add("/joints", states, time)


def _add_contacts(file: _File, result: Result, times: Sequence[int]) -> None:
    """Add the contacts of bodies with the pipes, found anew from the joint positions."""
    model = result.scenario.to_spec().compile()
    data = mujoco.MjData(model)
    keys = ("body", "x", "y", "z", "nx", "ny", "nz", "depth")
    contact = file.message("Contact", dict.fromkeys(keys, "double") | {"body": "string"})
    contacts = file.message("Contacts", {"contacts": contact})
    about = {
        "meaning": "contacts of bodies with the pipes: point x, y, z, unit normal into the bore "
        "nx, ny, nz, world frame, and depth in the wall",
        "unit": "m",
    }
    for time, qpos in zip(times, result.qpos, strict=True):
        made = contacts()
        if np.isfinite(qpos).all():
            for values in _contacts(model, data, qpos):
                made.contacts.add(**dict(zip(keys, values, strict=True)))
        file.add("/contacts", made, time, about)


def _contacts(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> Iterator[tuple]:
    """Yield body, point (3), normal (3) and depth of each contact with a pipe."""
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(model, data)
    for i in range(data.ncon):
        contact = data.contact[i]
        first, second = contact.geom.tolist()
        walls = [_is_wall(model, geom) for geom in (first, second)]
        if sum(walls) != 1:
            continue
        # MuJoCo's normal points from the first geom to the second.
        geom, side = (second, 1.0) if walls[0] else (first, -1.0)
        normal = side * contact.frame[:3]
        name = _body(model, int(model.geom_bodyid[geom]))
        yield (name, *contact.pos.tolist(), *normal.tolist(), -float(contact.dist))


def _is_wall(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_bodyid[geom] == 0) and model.geom(geom).name.startswith(PIPES)


def _add_channel(
    file: _File, result: Result, name: str, channel: Channel, times: Sequence[int]
) -> None:
    """Add a channel as a topic of its own, with a field for each of its numbers."""
    labels = _identifiers(label or "value" for label in labels_of(channel))
    fields = dict.fromkeys(labels, "int32" if channel.whole else "double")
    if name == PHASE:
        fields["name"] = "string"
    make = file.message(name.title().replace("_", ""), fields)
    about = {"unit": channel.unit, "meaning": channel.meaning, "frame": channel.frame}
    about["fields"] = ", ".join(labels_of(channel))
    values = result.trajectory[name].reshape(len(times), -1)
    for time, row in zip(times, values.tolist(), strict=True):
        numbers = [int(value) for value in row] if channel.whole else row
        texts = {"name": result.trajectory.phases[int(row[0])]} if name == PHASE else {}
        made = make(**dict(zip(labels, numbers, strict=True)), **texts)
        file.add(f"/channels/{name}", made, time, about)


def _identifiers(names: Iterable[str]) -> list[str]:
    """Return names that protobuf takes, all different, for any names."""
    made: list[str] = []
    for name in names:
        plain = _NAME.sub("_", name)
        plain = plain if plain[:1].isalpha() and plain.isascii() else f"n{plain.encode().hex()}"
        plain = f"n{name}" if name.isdecimal() else plain
        while plain in made:
            plain += "_"
        made.append(plain)
    return made


def _add_events(file: _File, result: Result) -> None:
    """Add what happened, as lines of a log."""
    for event in sorted(result.events, key=lambda one: one.time):
        line = file.foxglove("Log")
        time = round(1e9 * max(0.0, event.time)) if np.isfinite(event.time) else 0
        line.timestamp.FromNanoseconds(time)
        line.level = line.WARNING if isinstance(event, Note) else line.INFO
        line.name, line.message = type(event).__name__, str(event)
        file.add("/events", line, time)


def _body(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body_{body}"


_TYPES = {"double": 1, "int32": 5, "string": 9}
"""Types of fields, as protobuf numbers them."""


class _File:
    """An MCAP file in the making: schemas and topics come with their first message."""

    def __init__(self) -> None:
        from google.protobuf.descriptor_pool import DescriptorPool
        from mcap.writer import Writer

        self._pool = DescriptorPool()
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, int] = {}
        self._messages: list[tuple[int, int, bytes]] = []
        self._bytes = io.BytesIO()
        self._writer = Writer(self._bytes)
        self._writer.start(library="omnitrack_sim")

    def foxglove(self, name: str) -> Any:
        """Return an empty message of a schema of Foxglove's."""
        from importlib import import_module

        return getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)()

    def message(self, name: str, fields: Mapping[str, Any]) -> Any:
        """Return a class of messages of this package.

        Args:
            name: of the schema, below ``omnitrack_sim``.
            fields: their types by name: a key of ``_TYPES``, or the class of many messages.
        """
        from google.protobuf import descriptor_pb2, message_factory

        proto = descriptor_pb2.FileDescriptorProto(
            name=f"omnitrack_sim/{name}.proto", package="omnitrack_sim", syntax="proto3"
        )
        kind = proto.message_type.add(name=name)
        for number, (field, inner) in enumerate(fields.items(), start=1):
            own = kind.field.add(name=field, number=number)
            if isinstance(inner, str):
                own.label, own.type = own.LABEL_OPTIONAL, _TYPES[inner]
                continue
            own.label, own.type = own.LABEL_REPEATED, own.TYPE_MESSAGE
            own.type_name = f".{inner.DESCRIPTOR.full_name}"
            proto.dependency.append(inner.DESCRIPTOR.file.name)
        self._pool.Add(proto)
        found = self._pool.FindMessageTypeByName(f"omnitrack_sim.{name}")
        return message_factory.GetMessageClass(found)

    def add(self, topic: str, message: Any, time: int, about: dict[str, str] | None = None) -> None:
        """Add a message at a time, ns; ``about`` describes a topic of which it is the first."""
        if topic not in self._topics:
            schema = self._schema(message.DESCRIPTOR)
            self._topics[topic] = self._writer.register_channel(
                topic, "protobuf", schema, metadata=about or {}
            )
        data = message.SerializeToString(deterministic=True)
        self._messages.append((time, self._topics[topic], data))

    def _schema(self, descriptor: Any) -> int:
        name = descriptor.full_name
        if name not in self._schemas:
            from google.protobuf.descriptor_pb2 import FileDescriptorSet

            files: dict[str, Any] = {}
            _collect(descriptor.file, files)
            described = FileDescriptorSet()
            for file in files.values():
                file.CopyToProto(described.file.add())
            data = described.SerializeToString(deterministic=True)
            self._schemas[name] = self._writer.register_schema(name, "protobuf", data)
        return self._schemas[name]

    def finished(self, result: Result) -> bytes:
        """Return the bytes of the file, with scenario, result and versions as attachments."""
        # In order of time, as players read it.
        for time, topic, data in sorted(self._messages, key=lambda one: one[0]):
            self._writer.add_message(topic, time, data, time)
        texts = {
            "scenario.json": result.scenario.model_dump_json(indent=2),
            "result.json": strict_json(result.summary()),
        }
        for name, text in texts.items():
            self._writer.add_attachment(0, 0, name, "application/json", text.encode())
        versions = {k: v if isinstance(v, str) else json.dumps(v) for k, v in _made_by(result)}
        self._writer.add_metadata("omnitrack_sim", versions)
        self._writer.finish()
        return self._bytes.getvalue()


def _made_by(result: Result) -> Iterator[tuple[str, Any]]:
    yield "outcome", result.outcome.value
    yield from result.provenance.items()


def _collect(file: Any, files: dict[str, Any]) -> None:
    """Collect a file of descriptions by name, those that it depends on before it."""
    for needed in file.dependencies:
        _collect(needed, files)
    files.setdefault(file.name, file)
