"""An empty MjSpec with the project's numerics."""

from __future__ import annotations

import mujoco

TIMESTEP = 0.002
"""Default physics step, s."""
IMPEDANCE_RATIO = 10.0
"""Stiffness of friction against that of normal contact: creep of 6e-6 m/s for a climbing robot
instead of 6e-5 at 1."""


def new_spec(name: str) -> mujoco.MjSpec:
    """Radians, elliptic cones, implicitfast, dense (MuJoCo 4.0.0's sparse Hessian is wrong from 60
    dofs on)."""
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
