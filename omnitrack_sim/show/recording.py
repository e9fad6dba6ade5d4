"""Recording of any MuJoCo model in exact pipes, from which films, pages and figures are made."""

from __future__ import annotations

import io
import json
import os
import sys
import zipfile
from collections.abc import Collection
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.arguments import check_is, check_time
from omnitrack_sim.base.bounds import MAX_RECORDING_BYTES
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import trusting
from omnitrack_sim.base.reading import parsed, read_bytes
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.base.writing import check_file, format_of, npz_of, write_file
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.pipes.fittings.kinds import FittingEntry, table_of
from omnitrack_sim.results.files import reading
from omnitrack_sim.walls.around import AxisPoints, Pipes
from omnitrack_sim.walls.model_bounds import check_binary

if TYPE_CHECKING:
    import pandas

FIELDS = (
    "qpos",
    "qvel",
    "ctrl",
    "act",
    "actuator_force",
    "actuator_velocity",
    "mocap_pos",
    "mocap_quat",
)
"""Arrays of ``MjData`` that are recorded, by their names in MuJoCo."""
DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
"""Warnings after which MuJoCo sets its data back to the beginning."""
FORMAT = 1
"""Number of the form of a saved recording."""
SOONER = 1e-9
"""Time by which a sample may come before it is due, s: sums of time steps are off by less."""


class WallContacts(NamedTuple):
    """Contacts of a robot with the walls of its pipes.

    Attributes:
        sample: (C,) in which sample of the recording, in order.
        geom: (C,) number of the robot's geom.
        position: (C, 3) m, world frame.
        force: (C, 3) N, of the wall on the geom, world frame.
        normal: (C, 3) unit vectors from the wall into the bore, world frame.
        normal_force: (C,) N.
        distance: (C,) m, negative where the geom is within the wall.
    """

    sample: NDArray[Any]
    geom: NDArray[Any]
    position: NDArray[Any]
    force: NDArray[Any]
    normal: NDArray[Any]
    normal_force: NDArray[Any]
    distance: NDArray[Any]


class Recording:
    """States of any MuJoCo model with pipes of ``add_pipes`` over time.

    After ``mj_step`` forces and contacts are those of the step that has led to the state.

    Args:
        model: compiled, with the walls of ``pipes``.
        pipes: that ``add_pipes`` has returned, in the world.
        period: time between two samples, s; 0: every state that is appended.
        body: name of the robot's body that cameras keep with and figures tell of; None: the first
            one with a free joint, or else the first one with a joint.

    Attributes:
        model: as given.
        pipes: as given.
        period: as given.
        body: number of the body.
        is_wall: (ngeom,) geoms that are walls of ``pipes``.

    Raises:
        InputError: the model lacks these walls, its pipes move, it has no such body, or nothing in
            it moves; or the period is not from 0 on.

    Example:
        >>> import mujoco
        >>> spec = mujoco.MjSpec()
        >>> ball = spec.worldbody.add_body(name="ball", pos=[0.0, 0.0, 0.2])
        >>> _ = ball.add_freejoint(), ball.add_geom(size=[0.02, 0, 0])
        >>> network = ot.Network(fittings=[{"kind": "straight", "name": "a", "length": 0.5}])
        >>> pipes = ot.add_pipes(spec, network)
        >>> model = spec.compile()
        >>> data = mujoco.MjData(model)
        >>> recording = ot.Recording(model, pipes, period=0.02)
        >>> while data.time < 0.1:
        ...     mujoco.mj_step(model, data)
        ...     _ = recording.append(data)
        >>> recording
        Recording(5 samples, 0.002 to 0.082 s, of 'ball')
        >>> recording.qpos.shape
        (5, 7)
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        pipes: Pipes,
        *,
        period: float = 0.02,
        body: str | None = None,
    ) -> None:
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model: is a {type(model).__name__}; it must be a mujoco.MjModel")
        self.model, self.pipes = model, check_is(Pipes, "pipes", pipes)
        check_time("period", period)
        if not 0 <= period < np.inf:
            raise InputError(Fault("period", f"is {period!r}; a number from 0 on, s, is needed"))
        self.period = float(period)
        self.is_wall = np.zeros(model.ngeom, bool)
        self.is_wall[pipes.geoms(model)] = True
        if model.geom_bodyid[self.is_wall].any():
            problem = "has pipes on a body; only pipes of the world are recorded"
            raise InputError(Fault("model", problem))
        self.body = _chassis(model, body)
        self._samples: dict[str, list[Array]] = {name: [] for name in ("time", *FIELDS)}
        self._contacts: list[WallContacts] = []

    def __len__(self) -> int:
        return len(self._samples["time"])

    def __repr__(self) -> str:
        name = self.model.body(self.body).name
        if not len(self):
            return f"Recording(no samples, of {name!r})"
        first, last = self.time[[0, -1]]
        return f"Recording({len(self)} samples, {first:.6g} to {last:.6g} s, of {name!r})"

    def append(self, data: mujoco.MjData) -> bool:
        """Record a state if its sample is due; return whether it was.

        Raises:
            InputError: the data are of another model, their time goes back, or the physics has
                diverged.
        """
        model, time = self.model, float(data.time)
        sizes = ("nq", "nv", "nu", "na", "nmocap", "ngeom")
        if any(getattr(data.model, size) != getattr(model, size) for size in sizes):
            raise InputError(Fault("data", "are of another model than the recording's"))
        if any(data.warning[kind].number for kind in DIVERGED):
            problem = "have diverged: MuJoCo has found infinite or huge numbers, and begun anew"
            raise InputError(Fault("data", problem))
        if len(self):
            first, last = self._samples["time"][0], self._samples["time"][-1]
            if time < last - SOONER:
                problem = f"go back from {last:.6g} to {time:.6g} s; begin a new Recording"
                raise InputError(Fault("data", problem))
            # By whole periods from the first sample on, so that no error adds up.
            periods = np.floor((last - first) / self.period + 1e-6) + 1 if self.period else 0.0
            if time < first + periods * self.period - SOONER:
                return False
        self._contacts.append(self._wall_contacts(data))
        self._samples["time"].append(np.array(time))
        for name in FIELDS:
            self._samples[name].append(np.array(getattr(data, name)))
        for name in ("contacts", "bodies", "places"):  # of the samples so far
            self.__dict__.pop(name, None)
        return True

    def _wall_contacts(self, data: mujoco.MjData) -> WallContacts:
        """Return the contacts of a state with walls, as those of sample ``len(self)``."""
        contact = data.contact
        walls = self.is_wall[contact.geom]  # (ncon, 2)
        rows = np.flatnonzero(walls[:, 0] != walls[:, 1])
        force, six = np.zeros((len(rows), 3)), np.zeros(6)
        for i, row in enumerate(rows.tolist()):
            mujoco.mj_contactForce(self.model, data, row, six)
            force[i] = six[:3]
        first = walls[rows, 0]  # the robot's geom is the second one
        # Rows of the frame are normal and tangents; the normal points to the second geom.
        frame = contact.frame[rows].reshape(-1, 3, 3)
        sign = np.where(first, 1.0, -1.0)[:, None]
        world = sign * np.einsum("nij,ni->nj", frame, force)
        geom = np.where(first, contact.geom[rows, 1], contact.geom[rows, 0])
        return WallContacts(
            np.full(len(rows), len(self), np.intp),
            geom.astype(np.intp),
            np.array(contact.pos[rows]),
            world,
            sign * frame[:, 0],
            force[:, 0].copy(),
            np.array(contact.dist[rows]),
        )

    # What was recorded

    def __getitem__(self, name: str) -> Array:
        """Return ``time`` or one of MuJoCo's arrays in ``FIELDS`` of all samples, (T, ...)."""
        if name not in self._samples:
            raise KeyError(f"{name!r} is not recorded (choose from: {', '.join(self._samples)})")
        values = self._samples[name]
        return np.array(values) if values else np.zeros((0, *self._shape(name)))

    def _shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of one sample of an array."""
        model = self.model
        sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na}
        mocap = {"mocap_pos": (model.nmocap, 3), "mocap_quat": (model.nmocap, 4)}
        return () if name == "time" else mocap.get(name) or (sizes.get(name, model.nu),)

    @property
    def time(self) -> Array:
        """Times of the samples (T,), s."""
        return self["time"]

    @property
    def qpos(self) -> Array:
        """Joint positions (T, nq) m and rad, as MuJoCo's ``data.qpos`` has them."""
        return self["qpos"]

    @cached_property
    def contacts(self) -> WallContacts:
        """Contacts with the walls in all samples."""
        nothing = np.zeros(0, np.intp)
        none = WallContacts(nothing, nothing, *np.zeros((3, 0, 3)), *np.zeros((2, 0)))
        columns = zip(*[none, *self._contacts], strict=True)
        return WallContacts(*(np.concatenate(column) for column in columns))

    def wall_force(self) -> Array:
        """Return the sum of the normal forces of the walls on the robot, (T,) N."""
        contacts = self.contacts
        return np.bincount(contacts.sample, contacts.normal_force, len(self)).astype(float)

    def power(self) -> Array:
        """Return the mechanical power of all actuators, (T,) W: force times velocity."""
        return (self["actuator_force"] * self["actuator_velocity"]).sum(axis=1)

    @cached_property
    def bodies(self) -> Array:
        """Positions, m, and quaternions of all bodies, (T, nbody, 7), world frame."""
        data, poses = mujoco.MjData(self.model), np.zeros((len(self), self.model.nbody, 7))
        rows = zip(self["qpos"], self["mocap_pos"], self["mocap_quat"], strict=True)
        for pose, (qpos, place, turn) in zip(poses, rows, strict=True):
            data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, place, turn
            mujoco.mj_kinematics(self.model, data)
            pose[:, :3], pose[:, 3:] = data.xpos, data.xquat
        return poses

    @cached_property
    def places(self) -> AxisPoints:
        """Nearest points on the pipes' axes to the body, (T,); see ``Pipes.locate``."""
        return self.pipes.locate(self.bodies[:, self.body, :3])

    def progress(self) -> tuple[Array, Array]:
        """Return the way of the body along the pipes' axes, and which direction is forward.

        Returns:
            Way since the first sample (T,) m, positive as the body set out, and unit vectors (T, 3)
            along the axis.
        """
        position = self.bodies[:, self.body, :3]
        forward = _forward(self.pipes.locate(position).axis, position)
        step = np.diff(position, axis=0)
        along = (step * (forward[1:] + forward[:-1]) / 2).sum(axis=1)
        return np.append(0.0, np.cumsum(along)), forward

    def head(self, count: int) -> Self:
        """Return a recording of the first ``count`` samples."""
        short = type(self)(self.model, self.pipes, period=self.period)
        short.body = self.body
        short._samples = {name: values[:count] for name, values in self._samples.items()}
        short._contacts = self._contacts[:count]
        return short

    def to_pandas(self) -> pandas.DataFrame:
        """Return a pandas table: one row a sample, with the names of joints, actuators and bodies.

        After ``time`` come MuJoCo's arrays (``qpos_JOINT``, ``ctrl_ACTUATOR`` and so on), the pose
        of each body in the world (``position_BODY_x``, ``quaternion_BODY_w``), the sum of the
        normal forces of the walls on each (``wall_force_BODY``), and of the robot's body ``part``,
        that it is in, ``clearance`` and ``distance``, its way along the pipes.
        ``frame.attrs["units"]`` has the unit of each column.

        Raises:
            ImportError: pandas is not installed; it is no dependency of this package.
        """
        from omnitrack_sim.show.recording_tables import samples_table

        return samples_table(self)

    def contacts_to_pandas(self) -> pandas.DataFrame:
        """Return a pandas table of ``contacts``: one row a contact, with its time and its names.

        Columns are ``time``, ``sample``, ``body``, ``geom``, ``part`` of the pipes, ``position``,
        ``force`` and ``normal`` by x, y and z, ``normal_force`` and ``distance``.

        Raises:
            ImportError: pandas is not installed; it is no dependency of this package.
        """
        from omnitrack_sim.show.recording_tables import contacts_table

        return contacts_table(self)

    def require_samples(self) -> None:
        """Raise an ``InputError`` for a recording without samples."""
        if not len(self):
            raise InputError(Fault("recording", "has no samples; append states first"))

    # Files

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write model, pipes and samples into one file; equal recordings give equal bytes.

        The file is written whole or not at all.

        The model is in MuJoCo's binary form, which the same release reads.

        Raises:
            InputError: the path does not end in ``.npz``.
            OutputError: the file cannot be written.
        """
        path = Path(path)
        format_of(path, None, "recording", ("npz",))
        check_file(path)
        write_file(path, self._file())
        return path

    def __reduce__(self) -> tuple[Any, ...]:
        # A pickled model names its walls, which another process has to know before.
        return _of_file, (self._file(), tuple(sys.modules))

    def _file(self) -> bytes:
        """Return model, pipes and samples as the bytes of a file."""
        model = np.zeros(mujoco.mj_sizeModel(self.model), np.uint8)
        mujoco.mj_saveModel(self.model, None, model)
        head = {
            "format": FORMAT,
            "mujoco": mujoco.__version__,
            "period": self.period,
            "body": self.body,
            "parts": [
                {"name": part.name} | part.fitting.to_table() for part in self.pipes.assembly.parts
            ],
            "joints": self.pipes.assembly.joints,
        }
        poses = [part.pose for part in self.pipes.assembly.parts]
        arrays = {
            "head": np.frombuffer(json.dumps(head).encode(), np.uint8),
            "model": model,
            "part_position": np.array([pose.position for pose in poses]),
            "part_rotation": np.array([pose.rotation for pose in poses]),
            **{name: self[name] for name in self._samples},
            **{f"contact_{name}": values for name, values in self.contacts._asdict().items()},
        }
        return npz_of(arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> Self:
        """Read a saved recording, whose model and pipes are ready for use again.

        Args:
            path: of the file.
            trust: import modules of fittings of somebody's own, ``module:Class``. Otherwise a file
                that names one is refused, unless the module has been imported already.

        Raises:
            OutputError: the file is missing or damaged, or another release of MuJoCo wrote it.
        """
        with trusting(None if trust else ()), reading(Path(path)) as file:
            return cls._read(read_bytes(file, MAX_RECORDING_BYTES))

    @classmethod
    def _read(cls, file: bytes) -> Self:
        """Return the recording in the bytes of a file; any error where it is damaged."""
        with zipfile.ZipFile(io.BytesIO(file)) as archive:
            # Before anything is unpacked: a few bytes of zip may hold gigabytes.
            if sum(entry.file_size for entry in archive.infolist()) > MAX_RECORDING_BYTES:
                raise ValueError(f"unpacks to more than {MAX_RECORDING_BYTES} bytes")
        with np.load(io.BytesIO(file), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        head = parsed(arrays["head"].tobytes().decode(), "JSON")
        if head["mujoco"] != mujoco.__version__:
            raise ValueError(f"MuJoCo {head['mujoco']} wrote it, this is {mujoco.__version__}")
        # The walls have to be known before a binary model with them is used.
        pipes = Pipes(_assembly(head, arrays["part_position"], arrays["part_rotation"]))
        binary = {"model.mjb": arrays["model"].tobytes()}
        check_binary(binary["model.mjb"])
        model = mujoco.MjModel.from_binary_path("model.mjb", binary)
        recording = cls(model, pipes, period=head["period"])
        recording.body = int(head["body"])
        recording._fill(arrays)
        return recording

    def _fill(self, arrays: dict[str, Any]) -> None:
        """Take over the samples of a file.

        Raises:
            ValueError: an array has another shape than the model asks for.
        """
        samples = len(arrays["time"])
        for name, values in self._samples.items():
            if arrays[name].shape != (samples, *self._shape(name)):
                raise ValueError(f"{name} has the shape {arrays[name].shape}")
            values.extend(arrays[name])
        every = WallContacts(*(arrays[f"contact_{name}"] for name in WallContacts._fields))
        ends = np.searchsorted(every.sample, np.arange(samples + 1))
        for begin, end in pairwise(ends.tolist()):
            self._contacts.append(WallContacts(*(column[begin:end] for column in every)))


def _of_file(file: bytes, modules: Collection[str]) -> Recording:
    """Return the recording that another process has sent, which has imported ``modules``."""
    with trusting(modules):
        return Recording._read(file)


def _assembly(head: dict[str, Any], positions: Array, rotations: Array) -> Assembly:
    """Return the pipes of a saved recording."""
    parts = []
    for row, position, rotation in zip(head["parts"], positions, rotations, strict=True):
        name = row.pop("name")
        fitting = table_of(row["kind"], FittingEntry).model_validate(row).fitting()
        parts.append(Part(name, fitting, Pose(rotation, position)))
    joints = [tuple((int(part), str(port)) for part, port in joint) for joint in head["joints"]]
    return Assembly.unchecked(tuple(parts), tuple(joints))  # type: ignore[arg-type]


def _chassis(model: mujoco.MjModel, body: str | None) -> int:
    """Return the number of the robot's body."""
    names = tuple(model.body(i).name for i in range(1, model.nbody))
    if body is not None:
        if body not in names:
            raise InputError(Fault("body", f"is {body!r}", names, given=str(body)))
        return model.body(body).id
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    if not model.njnt:
        raise InputError(Fault("model", "has no joint, so nothing in it moves"))
    return int(model.jnt_bodyid[free[0] if len(free) else 0])


def _forward(axis: Array, position: Array) -> Array:
    """Return tangents (T, 3) of the pipes without a jump in their sense.

    ``axis`` (T, 3) is NaN outside the pipes. At first they point to where the body goes.
    """
    known = np.isfinite(axis).all(axis=1)
    if not known.any():
        return np.tile([0.0, 0.0, 1.0], (len(axis), 1))
    # Outside: as at the last place inside, or the first one.
    rows = np.maximum.accumulate(np.where(known, np.arange(len(axis)), np.argmax(known)))
    forward = axis[rows]
    turns = np.where((forward[1:] * forward[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    forward[1:] *= np.cumprod(turns)[:, None]
    along = np.cumsum((np.diff(position, axis=0) * forward[1:]).sum(axis=1))
    # The sense of the first half a way: the largest excursion decides.
    back = len(along) > 0 and along[np.abs(along).argmax()] < 0
    return -forward if back else forward
