"""Plants of robots whose physics MuJoCo Warp steps: for the loop of ``ot.Simulation``."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco import batch
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.plant import Plant, Start
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.warp.walls import Walls, put_model

CONTACTS, ROWS = 64, 320
"""Room for contacts in a world, on average, and for rows of constraints in a world, at most: a tee
turn of the paper's robot has 36 contacts and 150 rows at most."""
SEATED = 2e-7
"""Distance, m, by which contacts begin before the surface. Where a robot is seated springs and wall
are in equilibrium to 5 nm, which single precision does not hold: without it arms that no longer
touch would be thrown against the wall by 0.04 mm."""
GRID = 8.0
"""Origins of worlds are multiples of 1/8 m: positions move by them to the last bit."""
STATE = ("qpos", "qvel", "act", "qacc_warmstart")
INPUTS = ("ctrl", "qfrc_applied", "xfrc_applied")
BEFORE_POSITION = (1, 3, 3, 1)
"""Numbers of the fields of a contact sensor that come before the position: whether it is found,
force, torque, distance."""
UNREAD = ("dof_M0",)
"""Fields in which robots may differ and that no step of MuJoCo Warp reads: it has none such."""
_FULL = mjw.OverflowType.NEFC | mjw.OverflowType.NARROWPHASE


def make_plant(scenario: Scenario, start: Start, threads: int) -> Plant:
    """Return a plant whose steps MuJoCo Warp computes, on the device of Warp's choice.

    Robots are placed and seated on the processor, in double precision, to the state in which they
    start there. Sensors, motors and controllers are those of the processor; positions on the device
    count from a place near each robot.

    Args:
        scenario: the first of a batch.
        start: of its robots.
        threads: native threads, with which robots are seated.

    Raises:
        InputError: the walls are no exact ones, or have a geom that they cannot touch on a device.

    Example:
        >>> scenario = ot.load_scenario("tee_turn")
        >>> simulation = ot.Simulation([scenario] * 1024, make_plant=ot.warp.make_plant)
    """
    if scenario.physics.collider != "exact":
        problem = "is 'primitives': MuJoCo Warp steps robots in exact walls"
        raise InputError(Fault("physics.collider", problem, ("exact",)))
    model, period = scenario.to_spec().compile(), scenario.physics.control_period
    return scenario.robot.plant(model, start, period, threads, scenario.own_sensors, WarpBatch)


def put_seated_model(model: mujoco.MjModel) -> mjw.Model:
    """Put a model onto the device, see ``put_model``, in which seated robots stay at rest."""
    m, robot = put_model(model), model.geom_type > int(mujoco.mjtGeom.mjGEOM_HFIELD)
    m.geom_margin.assign(model.geom_margin[None] + SEATED * robot)
    return m


class FieldsBatch(batch.Batch):
    """A batch that knows what has been bound and expanded.

    Attributes:
        outputs: fields that a step computes, by name.
        fields: of the model, in which simulations may differ, by name.
    """

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int = 0, persistent: bool = False
    ) -> None:
        super().__init__(model, nsim, nthread, persistent)
        self.outputs: dict[str, NDArray[Any]] = {}
        self.fields: dict[str, NDArray[Any]] = {}

    def bind(self, name: str) -> NDArray[Any]:
        """See ``Batch``."""
        values = super().bind(name)
        if not values.flags.writeable:
            self.outputs[name] = values
        return values

    def expand(self, name: str) -> NDArray[Any]:
        """See ``Batch``."""
        self.fields[name] = super().expand(name)
        return self.fields[name]


class WarpBatch(FieldsBatch):
    """n simulations that MuJoCo Warp steps; all but ``step`` is the processor's.

    States and fields are arrays of the processor: a step takes them to the device, and brings back
    the states and the fields that are bound.
    """

    def __init__(
        self, model: mujoco.MjModel, nsim: int, nthread: int = 0, persistent: bool = False
    ) -> None:
        super().__init__(model, nsim, nthread, persistent)
        self._m = put_seated_model(model)
        self._d = mjw.make_data(model, nworld=nsim, nconmax=CONTACTS, njmax=ROWS)
        walls = self._m.callback.contactfilter
        assert isinstance(walls, Walls)
        self._free = np.zeros(0, int) if walls.free is None else walls.free.numpy().copy()
        walls.origins = wp.zeros(nsim, dtype=wp.vec3d)
        self._origins = walls.origins
        self._position_columns = position_columns(model)
        self._known: dict[str, NDArray[Any]] = {}
        self._graphs: dict[int, Any] = {}

    def step(
        self, ids: Any = None, nstep: int = 1, stage: int = mujoco.mjtStage.mjSTAGE_NONE.value
    ) -> None:
        """Advance simulations by ``nstep`` steps on the device.

        Raises:
            RuntimeError: contacts or rows of constraints find no room.
            ValueError: a stage is asked for, of which the device computes none.
        """
        if stage != mujoco.mjtStage.mjSTAGE_NONE.value:
            raise ValueError(f"stage is {stage}; steps on a device compute none at the new state")
        rows = np.arange(self.nsim) if ids is None else np.arange(self.nsim)[np.asarray(ids)]
        origins = self._put()
        self._d.overflow.zero_()
        self._run(nstep)
        self._get(rows, origins)
        full = self._d.overflow.numpy()[rows] & int(_FULL) != 0
        if full.any():
            raise RuntimeError(
                f"{np.count_nonzero(full)} worlds have more than {ROWS} rows of constraints, or "
                f"all together more than {self._d.naconmax} contacts"
            )
        time = self.bind("time")
        for _ in range(nstep):
            time[rows] += self.model.opt.timestep

    def _put(self) -> Array:
        """Bring states, inputs and fields to the device; returns the origins (n, 3) m."""
        for name, values in self.fields.items():
            self._put_field(name, values)
        qpos, origins = self.bind("qpos").copy(), np.zeros((self.nsim, 3))
        if len(self._free):
            place = self._free[0] + np.arange(3)
            origins = near_origins(qpos[:, place])
            for address in self._free:
                qpos[:, address : address + 3] -= origins
        self._origins.assign(origins)
        self._d.qpos.assign(qpos.astype(np.float32))
        for name in (*STATE[1:], *INPUTS):
            values = self.bind(name)
            if values.size:
                getattr(self._d, name).assign(values.astype(np.float32))
        return origins

    def _put_field(self, name: str, values: NDArray[Any]) -> None:
        """Bring a field of the model in which simulations may differ to the device."""
        if name in UNREAD or np.array_equal(self._known.get(name, ()), values):
            return
        if name in self._known or differs(self.model, name, values):
            old, new = field_of(self._m, name), put_field(self._m, name, values)
            if new is not old:
                self._graphs.clear()  # they hold the old array
        self._known[name] = values.copy()

    def _run(self, nstep: int) -> None:
        """Take steps; on a GPU as a graph."""
        if nstep in self._graphs:
            wp.capture_launch(self._graphs[nstep].graph)
            return
        for _ in range(nstep):
            mjw.step(self._m, self._d)
        if wp.get_device().is_cuda:
            with wp.ScopedCapture() as self._graphs[nstep]:
                for _ in range(nstep):
                    mjw.step(self._m, self._d)

    def _get(self, rows: NDArray[np.intp], origins: Array) -> None:
        """Bring back states and bound fields of simulations ``rows``."""
        for name in STATE:
            values = self.bind(name)
            if values.size:
                values[rows] = getattr(self._d, name).numpy()[rows]
        for address in self._free:
            self.bind("qpos")[rows, address : address + 3] += origins[rows]
        for name, values in self.outputs.items():
            told = getattr(self._d, name).numpy().reshape(values.shape)[rows].astype(values.dtype)
            if name in ("xpos", "xipos", "site_xpos", "geom_xpos"):
                told += origins[rows, None]
            elif name == "sensordata":
                for columns in self._position_columns:
                    told[:, columns] += origins[rows]
            # An output of the batch, which this is.
            values.flags.writeable = True
            values[rows] = told
            values.flags.writeable = False


def near_origins(positions: Array) -> Array:
    """Return an origin (n, 3) m near each robot's position; what is no number counts as 0."""
    return np.round(np.nan_to_num(positions) * GRID) / GRID


def differs(model: mujoco.MjModel, name: str, values: NDArray[Any]) -> bool:
    """Return whether values (n, ...) of a field are others than those of a model."""
    return bool((values != field_of(model, name)).any())


def place_of(model: Any, name: str) -> tuple[Any, str]:
    """Return what holds a field of a model, and its name there: ``opt.gravity`` is an option's."""
    return (model.opt, name.removeprefix("opt.")) if name.startswith("opt.") else (model, name)


def field_of(model: Any, name: str) -> Any:
    """Return a field of a model, of the processor or on the device; None where there is none."""
    return getattr(*place_of(model, name), None)


def put_field(m: mjw.Model, name: str, values: NDArray[Any]) -> Any:
    """Give each world its own values (n, ...) of a field; returns the array on the device.

    Raises:
        NotImplementedError: the field is one for all worlds.
    """
    array = field_of(m, name)
    if array is None or array.numpy()[0].size != values[0].size:
        raise NotImplementedError(f"worlds differ in {name}, which MuJoCo Warp has one of for all")
    if array.shape[0] == len(values):
        array.assign(values.astype(np.float32))
        return array
    new = wp.array(values, dtype=array.dtype)
    setattr(*place_of(m, name), new)
    return new


def position_columns(model: mujoco.MjModel) -> list[slice]:
    """Return the columns of ``sensordata`` that are positions in the world."""
    kinds, begins = mujoco.mjtSensor, []
    position = int(mujoco.mjtConDataField.mjCONDATA_POS)
    for i in range(model.nsensor):
        kind, first = int(model.sensor_type[i]), int(model.sensor_adr[i])
        fixed = kind == kinds.mjSENS_FRAMEPOS and model.sensor_refid[i] < 0
        if kind == kinds.mjSENS_SUBTREECOM or fixed:
            begins.append(first)
        wanted, _, slots = model.sensor_intprm[i, :3].tolist()
        if kind == kinds.mjSENS_CONTACT and wanted >> position & 1:
            sizes = enumerate(BEFORE_POSITION)
            before = sum(size for field, size in sizes if wanted >> field & 1)
            width = int(model.sensor_dim[i]) // slots
            begins += [first + slot * width + before for slot in range(slots)]
    return [slice(begin, begin + 3) for begin in begins]
