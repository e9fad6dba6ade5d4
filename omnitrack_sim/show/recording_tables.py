"""Tables of a recording for pandas: samples, and contacts with the walls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.results.dataset import Series
from omnitrack_sim.robots.actuator_units import actuator_units
from omnitrack_sim.robots.model_sensors import actuator_names
from omnitrack_sim.show.recording import FIELDS, Recording
from omnitrack_sim.show.wall_forces import body_forces

if TYPE_CHECKING:
    import pandas

PLACE, TURN = ("x", "y", "z"), ("w", "x", "y", "z")
_KINDS = mujoco.mjtJoint
POSITIONS = {
    int(_KINDS.mjJNT_FREE): (*PLACE, "qw", "qx", "qy", "qz"),
    int(_KINDS.mjJNT_BALL): TURN,
}
VELOCITIES = {
    int(_KINDS.mjJNT_FREE): ("vx", "vy", "vz", "wx", "wy", "wz"),
    int(_KINDS.mjJNT_BALL): ("wx", "wy", "wz"),
}
"""Letters of the numbers of a joint in ``qpos`` and ``qvel``; slides and hinges have one each."""
UNITS = {
    "qpos": "m, rad",
    "qvel": "m/s, rad/s",
    "mocap_pos": "m",
}
"""Units of MuJoCo's arrays but those of actuators; the others have none."""
_UNITS = {"position": "m", "force": "N"}  # of vectors of a contact


def samples_table(recording: Recording) -> pandas.DataFrame:
    """Return the table of ``Recording.to_pandas``."""
    frame, units = _frame(), {"time": "s"}
    columns: dict[str, Any] = {"time": recording.time}
    for one in recorded_series(recording):
        for label, unit, column in zip(one.labels, one.units, one.values.T, strict=True):
            key = "_".join(filter(None, (one.name, label)))
            columns[key], units[key] = column, unit
    part = recording.places.part
    names = np.array([*(p.name for p in recording.pipes.assembly.parts), ""], object)
    columns["part"], units["part"] = names[part], ""
    table = frame(columns)
    table.attrs["units"] = units
    return table


def recorded_series(recording: Recording) -> list[Series]:
    """Return all quantities of a recording over time."""
    return [
        Series(name, labels, [unit] * len(labels), values.reshape(len(recording), len(labels)))
        for name, unit, labels, values in _blocks(recording)
    ]


def _blocks(recording: Recording) -> Iterator[tuple[str, str, list[str], Array]]:
    """Yield name, unit, labels of the columns, and values (T, ...) of each quantity."""
    model = recording.model
    bodies = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
    motors = list(actuator_names(model))
    labels = {
        "qpos": _joint_labels(model, POSITIONS),
        "qvel": _joint_labels(model, VELOCITIES),
        "act": [str(i) for i in range(model.na)],
        "mocap_pos": _each(_mocap(model, bodies), PLACE),
        "mocap_quat": _each(_mocap(model, bodies), TURN),
    }
    units = UNITS | actuator_units(model)
    for name in FIELDS:
        yield name, units.get(name, ""), labels.get(name, motors), recording[name]
    poses = recording.bodies[:, 1:]
    yield "position", "m", _each(bodies[1:], PLACE), poses[..., :3]
    yield "quaternion", "", _each(bodies[1:], TURN), poses[..., 3:]
    touching = np.unique(model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) > 0])
    rows = touching[touching > 0].tolist()
    forces = body_forces(recording.contacts, model, len(recording))
    yield "wall_force", "N", [bodies[i] for i in rows], forces[:, rows]
    yield "clearance", "m", [""], recording.places.clearance
    yield "distance", "m", [""], recording.progress()[0]


def _each(names: list[str], letters: tuple[str, ...]) -> list[str]:
    return [f"{name}_{letter}" for name in names for letter in letters]


def _mocap(model: mujoco.MjModel, bodies: list[str]) -> list[str]:
    """Return the names of the mocap bodies, in their order."""
    rows = np.argsort(np.where(model.body_mocapid < 0, model.nbody, model.body_mocapid))
    return [bodies[i] for i in rows[: model.nmocap].tolist()]


def _joint_labels(model: mujoco.MjModel, letters: dict[int, tuple[str, ...]]) -> list[str]:
    """Return the names of the numbers of all joints, in MuJoCo's order."""
    labels = []
    for i, kind in enumerate(model.jnt_type.tolist()):
        name = model.joint(i).name or f"joint_{i}"
        labels += [f"{name}_{one}" for one in letters[kind]] if kind in letters else [name]
    return labels


def contacts_table(recording: Recording) -> pandas.DataFrame:
    """Return the table of ``Recording.contacts_to_pandas``."""
    frame, contacts, model = _frame(), recording.contacts, recording.model
    geoms = [model.geom(i).name or f"geom_{i}" for i in range(model.ngeom)]
    bodies = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
    parts = [*(part.name for part in recording.pipes.assembly.parts), ""]
    place = recording.pipes.locate(contacts.position).part
    columns: dict[str, Any] = {
        "time": recording.time[contacts.sample],
        "sample": contacts.sample,
        "body": np.array(bodies, object)[model.geom_bodyid[contacts.geom]],
        "geom": np.array(geoms, object)[contacts.geom],
        "part": np.array(parts, object)[place],
    }
    vectors = {"position": contacts.position, "force": contacts.force, "normal": contacts.normal}
    for name, values in vectors.items():
        columns |= {f"{name}_{axis}": values[:, i] for i, axis in enumerate(PLACE)}
    columns |= {"normal_force": contacts.normal_force, "distance": contacts.distance}
    table = frame(columns)
    units = {"time": "s", "distance": "m", "normal_force": "N"}
    units |= {f"{name}_{axis}": unit for name, unit in _UNITS.items() for axis in PLACE}
    table.attrs["units"] = {name: units.get(name, "") for name in columns}
    return table


def _frame() -> Any:
    """Return the class of tables.

    Raises:
        ImportError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise ImportError("tables need pandas: pip install pandas") from error
    return pandas.DataFrame
