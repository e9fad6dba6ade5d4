"""What the ranges of single values cannot say: which values of a robot go together."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from omnitrack_sim.robots.omnitrack.quantity import ROUNDING

if TYPE_CHECKING:
    from omnitrack_sim.robots.omnitrack.parameters import Robot

LONGEST_PRESS = 1.0
"""By how much the springs may be pressed together in the nominal pipe, m, in a robot of scale 1: a
force that hardly changes with the bore asks for long springs, but hardly for longer ones."""


def refuse_misfits(robot: Robot) -> None:
    """Refuse a robot whose values, each within its range, do not go together.

    Raises:
        ValidationError: with every misfit.
    """
    faults = [
        InitErrorDetails(
            type=PydanticCustomError("misfit", "{problem}", {"problem": problem}),
            loc=tuple(path.split(".")),
            input=functools.reduce(getattr, path.split("."), robot),
        )
        for path, problem in _misfits(robot)
    ]
    if faults:
        raise ValidationError.from_exception_data("Robot", faults)


def _misfits(robot: Robot) -> Iterator[tuple[str, str]]:
    """What does not go together in a robot, each value of which may be right: the field to be
    changed, and what is wrong with it."""
    nominal, low = robot.nominal_pipe_radius, robot.nominal_pipe_radius - robot.lug_radius
    if robot.reach <= nominal:
        yield "reach", f"must be over nominal_pipe_radius, {nominal:.6g} m"
    if low <= 0:
        yield "lug_radius", f"must be under nominal_pipe_radius, {nominal:.6g} m"
    elif robot.slide_travel_inward >= low:
        problem = f"would take a module's axis beyond the robot's; must be under {low:.6g} m"
        yield "slide_travel_inward", problem
    if robot.track_offset > robot.lug_radius / 2:
        problem = f"must be at most half of lug_radius, {robot.lug_radius / 2:.6g} m"
        yield "track_offset", problem
    press, most = robot.preload / robot.module_stiffness, LONGEST_PRESS * robot.scale
    if press > most * (1 + ROUNDING):
        problem = (
            f"would press the springs together by {press:.4g} m in the nominal pipe, at "
            f"{robot.module_stiffness:.4g} N/m a module; at most {most:.4g} m"
        )
        yield "preload", problem
    if robot.feasible_belt_speed <= 0:
        load = f"{robot.climbing_torque:.4g} N m"
        problem = f"cannot carry the robot: a third of its weight is {load} at a module's shaft"
        yield "motor.stall_torque", problem
