"""An empty MjSpec with the project's numerics."""

from __future__ import annotations

import mujoco

TIMESTEP = 0.002
"""Default physics step, s."""
IMPEDANCE_RATIO = 10.0
"""Stiffness of friction against that of normal contact: creep of 6e-6 m/s for a climbing robot
instead of 6e-5 at 1."""


MUJOCOS_LOG = "MUJOCO_LOG.TXT"
"""File in the working folder to which MuJoCo adds every warning unless it is told not to."""


def leave_no_log() -> None:
    """Keep MuJoCo, in this process and all of its threads, from leaving its log in the working
    folder.

    Warnings are counted and go to standard error as before. A log under another name, which
    somebody has asked for, stays.
    """
    config = mujoco.MjLogConfig.get()
    if config.logto_file and config.logfile == MUJOCOS_LOG:
        config.logto_file = False
        config.set()


def new_spec(name: str) -> mujoco.MjSpec:
    """Radians, elliptic cones, implicitfast, dense (MuJoCo 4.0.0's sparse Hessian is wrong from 60
    dofs on).

    Every model of the package begins here, so here MuJoCo is told to leave no log.
    """
    leave_no_log()
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    option = spec.option
    option.timestep = TIMESTEP
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.impratio = IMPEDANCE_RATIO
    return spec
