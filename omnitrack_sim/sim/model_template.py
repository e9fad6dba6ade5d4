"""Template of a scenario file for a robot of somebody else, and of a controller to fill in."""

from __future__ import annotations

import math
import os
import re
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.rotations import cross, dot
from omnitrack_sim.base.text import as_toml, counted, toml_key
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.model_look import ModelLook, look_at
from omnitrack_sim.scenario import Scenario, validate

STEPS = (5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 125, 200, 250, 500, 1000)
"""Time steps of a control period of 10 ms that a file may have."""
PERIOD = 0.01
"""Control period, s."""
WIDTH, INDENT = 100, "    "
"""Longest line of a comment, characters, and what stands before it in a class."""
SECONDS = 10.0
"""Least time limit of the run, s; a longer one is half as long again as the way takes."""
_CONTROLLER = '''"""Controller of {name}.toml, to fill in: it gives the inputs of the scenario."""

import omnitrack_sim as ot


class Controller(ot.Periodic):
    """Inputs of [control.parameters.inputs], and what you add.

{actuators}
    """

    def step(self, observation):
        """Return the inputs (n, {count}) of n robots until the next control step.

        `observation` has `time`, `qpos`, `qvel`, `position`, `rotation`, each named sensor of the
        model, and `location`: `distance` along the pipes, `tilt`, `tangent`, `curvature`.
        """
        inputs = super().step(observation).ctrl
        return ot.Actuation(inputs)
'''


@dataclass(frozen=True)
class ModelTemplate:
    """Two files that belong together.

    Attributes:
        scenario: text of NAME.toml, which is read as a scenario.
        module: name of the controller's module, whose file lies beside it.
        controller: text of that file.
    """

    scenario: str
    module: str
    controller: str


def model_template(name: str, file: str, folder: Path = Path(), body: str = "") -> ModelTemplate:
    """Return a scenario for a robot in a level straight of its size, and its controller.

    Args:
        name: of the new scenario.
        file: MJCF or URDF.
        folder: that the scenario will lie in.
        body: the chassis; "" where the file tells.

    Raises:
        InputError: it is no robot.
    """
    look = look_at(file, body)
    module = f"{re.sub(r'[^0-9A-Za-z_]', '_', name).lstrip('0123456789')}_control"
    names = look.robot.channels["ctrl"].names
    scenario = "\n".join([*_lines(name, module, look, file, folder), ""])
    listed = f"Actuators, in the order of the inputs: {', '.join(names) or 'none'}."
    code = _CONTROLLER.format(
        name=name,
        actuators=textwrap.fill(listed, WIDTH, initial_indent=INDENT, subsequent_indent=INDENT),
        count=len(names),
    )
    return ModelTemplate(scenario, module, code)


def model_scenario(file: str, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Return the scenario of ``model_template``, with the inputs to try and no module beside it.

    Args:
        file: MJCF or URDF.
        changes: values by dotted path, as ``load_scenario`` takes them.

    Raises:
        InputError: it is no robot, or the changes are at fault.
    """
    body = str((changes or {}).get("robot.body", ""))
    data = tomllib.loads(model_template(Path(file).stem, file, body=body).scenario)
    data["control"]["kind"] = "periodic"
    return validate(data, changes=changes)


def _lines(name: str, module: str, look: ModelLook, file: str, folder: Path) -> Iterator[str]:
    robot = look.robot
    pipe = {"kind": "straight", "length": _pipe_length(look), "inner_diameter": robot.bore}
    yield f"# {Path(file).name} in a level straight of its size, as it was found in the file."
    yield f"# `omnitrack new all --from {name}.toml` writes the same scenario with all keys."
    yield f"name = {as_toml(name)}"
    yield from _robot(look, os.path.relpath(file, folder))
    yield from (
        "",
        "[control]",
        f'kind = "{module}:Controller"  # "periodic" does without the file',
    )
    yield from ("", "[control.parameters.inputs]  # by actuator, to try")
    yield from (f"{toml_key(key)} = {as_toml(value)}" for key, value in look.inputs.items())
    yield from ("", "[start]", "axis = [1, 0, 0]  # of the pipe: level")
    yield f"distance = {_short(0.75 * robot.length)}  # m, of the robot's middle"
    yield f"theta5_deg = {_upright(look, pipe)}  # about the pipe's axis: its top is up"
    seconds = _short(max(SECONDS, 1.5 * pipe["length"] / robot.nominal_speed))
    yield from ("", "[run]", f"time_limit = {seconds}  # s")
    yield from ("", "[physics]", f"timestep = {_timestep(look)}  # s; 2 ms, or what it needs")
    yield from ("", "[[pipes]]", *(f"{key} = {as_toml(value)}" for key, value in pipe.items()))


def _robot(look: ModelLook, file: str) -> Iterator[str]:
    """Lines of the robot's table."""
    robot, wheels = look.robot, look.wheels
    found = [f"{wheel.joint} (radius {1000 * wheel.radius:.3g} mm)" for wheel in wheels]
    joints = counted(len(robot.joints) - 1, "joint")
    yield from ("", "[robot]", 'kind = "mjcf"', f"file = {as_toml(file)}  # relative to this file")
    chassis = f"{as_toml(robot.chassis)}, which carries {joints}"
    if robot.body:
        yield f"body = {as_toml(robot.body)}  # the chassis"
    yield f"# The chassis is {chassis}."
    yield from textwrap.wrap(
        f"# Wheels: {', '.join(found) or 'none were found'}.", WIDTH, subsequent_indent="# "
    )
    if robot.keyframes:
        others = ", ".join(robot.keyframes)
        yield f"#keyframe = {as_toml(robot.keyframes[0])}  # begin in a saved state: {others}"
    why = "across the wheels' axles" if wheels else "along its longer side"
    yield f'forward = "{robot.forward}"  # to the nose: {why}; "-{robot.forward}" if it is the tail'
    if any(robot.centre):
        yield f"centre = {as_toml(robot.centre)}  # m, of its cross section, from the chassis"
    yield f"bore = {robot.bore}  # m, of a pipe round it, with 5 % play if no wheels press on it"
    for servo in robot.servos:
        yield from ("", "[[robot.servos]]  # the file has no actuators")
        data = servo.model_dump(mode="json", exclude_none=True)
        yield from (f"{key} = {as_toml(value)}" for key, value in data.items() if value)


def _pipe_length(look: ModelLook) -> float:
    return _short(4 * look.robot.length + 2 * look.robot.nominal_bore)


def _upright(look: ModelLook, pipe: dict[str, Any]) -> float:
    """Return the angle about a level pipe, deg, at which what is up in the model is up."""
    start = {"axis": [1, 0, 0], "distance": pipe["length"] / 2}
    robot = look.robot.model_dump(mode="json")
    route = validate({"pipes": [pipe], "start": start, "robot": robot}).route
    routes, up = RouteMap([route]), np.array([0.0, 0.0, 1.0])
    middle, zero = np.full(1, pipe["length"] / 2), np.zeros(1, int)
    _, (rotation,) = routes.start_poses(zero, middle, np.zeros(1))
    own, axis = rotation @ look.up, rotation[:, 2]
    angle = math.atan2(dot(cross(own, up), axis), dot(own, up) - dot(own, axis) * dot(up, axis))
    return round(math.degrees(angle), 1) + 0.0


def _timestep(look: ModelLook) -> float:
    """Return the robot's time step, s, or the next smaller one that fits the control period."""
    fits = (count for count in STEPS if PERIOD / count <= look.timestep * 1.001)
    return PERIOD / next(fits, STEPS[-1])


def _short(value: float) -> float:
    return float(f"{value:.3g}")
