"""A run or recording as MCAP, for Foxglove and Rerun: poses, joints, contacts, channels, shapes.

Messages are those of Foxglove's schemas, and for channels and contacts plain ones of this package,
all in protobuf, whose descriptions stand in the file.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import strict_json
from omnitrack_sim.record.events import Note
from omnitrack_sim.results.dataset import Series, series_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.recorded import Recorded
from omnitrack_sim.robots.scene import PIPES
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.recording import Recording
from omnitrack_sim.show.recording_playback import RecordingPlayback
from omnitrack_sim.show.recording_tables import recorded_series
from omnitrack_sim.show.sources import playback_of
from omnitrack_sim.show.surfaces import Surface, geoms_surface, pipe_inside

WORLD = "world"
"""Frame of the pipes; those of bodies have the bodies' names."""
PIPE_ALPHA = 0.25
"""Opacity of the pipes, through which the robot is seen."""
_NAME = re.compile(r"\W")


def to_mcap(source: Result | Recording) -> bytes:
    """Return a run or a recording as the bytes of an MCAP file; equal ones give equal bytes.

    A run that was read without trust, whose robot is only known by its pictures, has no contacts.

    Raises:
        ImportError: the extra ``mcap`` is not installed.
        InputError: a recording has no samples.
        RenderError: the run has no pose that can be shown.
    """
    file, playback = _File(), playback_of(source, coarse=False)
    shown = playback.recording if isinstance(playback, RecordingPlayback) else source
    times = [round(1e9 * time) for time in playback.time.tolist()]  # ns
    _add_shapes(file, playback, times[0])
    _add_poses(file, playback, _robot_poses(shown, playback), times)
    _add_joints(file, playback.model, shown.qpos, times)
    _add_contacts(file, shown, times)
    for series in series_of(shown) if isinstance(shown, Result) else recorded_series(shown):
        _add_series(file, series, times)
    for time, name, text, is_note in _events(shown, playback):
        _add_event(file, time, name, text, is_note)
    return file.finished(*_about(shown, playback))


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


def _add_poses(file: _File, playback: Playback, robot: Array, times: Sequence[int]) -> None:
    """Add the frame of each body, and that of the robot (T, 7), at each sample."""
    model = playback.model
    bodies = range(1, model.nbody)
    names = [_body(model, body) for body in bodies]
    for time, row, own in zip(times, playback.body_poses(bodies), robot, strict=True):
        frames = file.foxglove("FrameTransforms")
        for name, pose in zip(names, row, strict=True):
            frame = frames.transforms.add(parent_frame_id=WORLD, child_frame_id=name)
            frame.timestamp.FromNanoseconds(time)
            _put_pose(frame.translation, frame.rotation, pose)
        file.add("/tf", frames, time)
        place = file.foxglove("PoseInFrame")
        place.frame_id = WORLD
        place.timestamp.FromNanoseconds(time)
        _put_pose(place.pose.position, place.pose.orientation, own)
        file.add("/pose", place, time)


def _robot_poses(source: Result | Recording, playback: Playback) -> Array:
    """Positions, m, and quaternions (T, 7) of the robot's frame; of a recording its body's."""
    if isinstance(source, Result):
        return np.hstack([source.trajectory["position"], source.trajectory["quaternion"]])
    return source.bodies[:, playback.body]


def _put_pose(position: Any, orientation: Any, pose: Array) -> None:
    """Write position and quaternion (w, x, y, z), (7,), into a message's parts."""
    position.x, position.y, position.z, w, x, y, z = pose.tolist()
    orientation.w, orientation.x, orientation.y, orientation.z = w, x, y, z


def _add_joints(file: _File, model: mujoco.MjModel, qpos: Array, times: Sequence[int]) -> None:
    """Add the positions of slides and hinges, m and rad; other joints are in the poses."""
    kinds = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    joints = np.flatnonzero(np.isin(model.jnt_type, kinds))
    names = [model.joint(i).name or f"joint_{i}" for i in joints]
    for time, row in zip(times, qpos[:, model.jnt_qposadr[joints]].tolist(), strict=True):
        states = file.foxglove("JointStates")
        states.timestamp.FromNanoseconds(time)
        for name, position in zip(names, row, strict=True):
            states.joints.add(name=name, position=position)
        file.add("/joints", states, time)


def _add_contacts(file: _File, source: Result | Recording, times: Sequence[int]) -> None:
    """Add the contacts of bodies with the pipes at each sample, where they can be known."""
    found = _known_contacts(source)
    if found is None:
        return
    keys, samples = found
    contact = file.message("Contact", dict.fromkeys(keys, "double") | {"body": "string"})
    contacts = file.message("Contacts", {"contacts": contact})
    about = {"meaning": _CONTACTS, "unit": "m, N"}
    for time, each in zip(times, samples, strict=True):
        made = contacts()
        for values in each:
            made.contacts.add(**dict(zip(keys, values, strict=True)))
        file.add("/contacts", made, time, about)


_KEYS = ("body", "x", "y", "z", "nx", "ny", "nz", "depth")
_CONTACTS = (
    "contacts of bodies with the pipes: point x, y, z, unit normal into the bore nx, ny, nz, world "
    "frame, depth in the wall; of a recording the force of the wall fx, fy, fz as well"
)


def _known_contacts(
    source: Result | Recording,
) -> tuple[tuple[str, ...], Iterator[list[tuple]]] | None:
    """Return the names of the figures of a contact, and the contacts of each sample.

    Those of a run are found anew from its joint positions; a recording has them.
    """
    if isinstance(source, Recording):
        return (*_KEYS, "fx", "fy", "fz"), _recorded_contacts(source)
    if isinstance(source.scenario.robot, Recorded):
        return None
    model = source.scenario.to_spec().compile()
    data = mujoco.MjData(model)
    found = (
        list(_contacts(model, data, qpos)) if np.isfinite(qpos).all() else []
        for qpos in source.qpos
    )
    return _KEYS, found


def _recorded_contacts(recording: Recording) -> Iterator[list[tuple]]:
    """Yield the contacts of each sample of a recording."""
    contacts, model = recording.contacts, recording.model
    bodies = [_body(model, int(model.geom_bodyid[geom])) for geom in contacts.geom]
    depth = -contacts.distance[:, None]
    rows = np.hstack([contacts.position, contacts.normal, depth, contacts.force]).tolist()
    ends = np.searchsorted(contacts.sample, np.arange(len(recording) + 1))
    for first, last in pairwise(ends.tolist()):
        yield [(bodies[i], *rows[i]) for i in range(first, last)]


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


def _add_series(file: _File, series: Series, times: Sequence[int]) -> None:
    """Add a series as a topic of its own, with a field for each of its numbers."""
    if not series.labels:
        return
    labels = _identifiers(label or "value" for label in series.labels)
    fields = dict.fromkeys(labels, "int32" if series.whole else "double")
    words = [{} for _ in times] if series.words is None else [{"name": w} for w in series.words]
    if series.words is not None:
        fields["name"] = "string"
    (name,) = _identifiers([series.name])
    make = file.message(name.title().replace("_", ""), fields)
    about = {"unit": ", ".join(dict.fromkeys(series.units)), "fields": ", ".join(series.labels)}
    about |= {"meaning": series.meaning, "frame": series.frame}
    for time, row, text in zip(times, series.values.tolist(), words, strict=True):
        numbers = [int(value) for value in row] if series.whole else row
        made = make(**dict(zip(labels, numbers, strict=True)), **text)
        file.add(f"/channels/{series.name}", made, time, about)


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


def _events(
    source: Result | Recording, playback: Playback
) -> Iterator[tuple[float, str, str, bool]]:
    """Yield time, s, kind and words of what happened, and whether it is a remark."""
    if isinstance(source, Recording):
        yield from ((time, "Recording", text, False) for time, text in playback.events)
        return
    for event in sorted(source.events, key=lambda one: one.time):
        yield event.time, type(event).__name__, str(event), isinstance(event, Note)


def _add_event(file: _File, time: float, name: str, text: str, is_note: bool) -> None:
    """Add what happened as a line of a log."""
    line = file.foxglove("Log")
    at = round(1e9 * max(0.0, time)) if np.isfinite(time) else 0
    line.timestamp.FromNanoseconds(at)
    line.level, line.name, line.message = line.WARNING if is_note else line.INFO, name, text
    file.add("/events", line, at)


def _about(source: Result | Recording, playback: Playback) -> tuple[dict[str, str], dict[str, Any]]:
    """Texts of the attachments of a file by their names, and what its metadata say."""
    if isinstance(source, Recording):
        return {}, {"name": playback.name}
    texts = {
        "scenario.json": source.scenario.model_dump_json(indent=2),
        "result.json": strict_json(source.summary()),
    }
    return texts, {"outcome": source.outcome.value, **source.provenance}


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
        self._names: set[str] = set()
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
            name: of the schema, below ``omnitrack_sim``; one that is taken gets a tail.
            fields: their types by name: a key of ``_TYPES``, or the class of many messages.
        """
        from google.protobuf import descriptor_pb2, message_factory

        while name in self._names:
            name += "_"
        self._names.add(name)
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

    def finished(self, texts: Mapping[str, str], about: Mapping[str, Any]) -> bytes:
        """Return the bytes of the file, with JSON as attachments, and metadata."""
        # In order of time, as players read it.
        for time, topic, data in sorted(self._messages, key=lambda one: one[0]):
            self._writer.add_message(topic, time, data, time)
        for name, text in texts.items():
            self._writer.add_attachment(0, 0, name, "application/json", text.encode())
        words = {k: v if isinstance(v, str) else json.dumps(v) for k, v in about.items()}
        self._writer.add_metadata("omnitrack_sim", words)
        self._writer.finish()
        return self._bytes.getvalue()


def _collect(file: Any, files: dict[str, Any]) -> None:
    """Collect a file of descriptions by name, those that it depends on before it."""
    for needed in file.dependencies:
        _collect(needed, files)
    files.setdefault(file.name, file)
