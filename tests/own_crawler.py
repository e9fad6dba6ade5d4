"""A robot of a user's own: a hull with two rings of three driven wheels on sprung arms."""

import math
from pathlib import Path

import numpy as np

import omnitrack_sim as ot

SIDES = ("top_centre", "lower_port_side", "lower_starboard")
WHEELS = [f"{ring}_driven_wheel_assembly_{side}" for ring in ("front", "rear") for side in SIDES]
MOTORS = [f"{ring}_wheel_motor_{side}" for ring in ("front", "rear") for side in SIDES]
HULL = "main_pressure_hull_with_electronics"


def crawler_xml(driven: bool = True, more: str = "") -> str:
    """The model as MJCF; with ``more`` in its world. Its nose is along x."""
    arms = []
    for k, name in enumerate(WHEELS):
        x, angle = (0.052, -0.052)[k // 3], 2 * math.pi * (k % 3) / 3
        y, z = math.sin(angle), math.cos(angle)
        axle = f"0 {-z:.6f} {y:.6f}"
        ends = " ".join(f"0 {-s * z:.6f} {s * y:.6f}" for s in (-0.008, 0.008))
        arms.append(
            f"<body name='arm_{k}' pos='{x} {0.05 * y:.6f} {0.05 * z:.6f}'>"
            f"<joint name='slide_{k}' type='slide' axis='0 {y:.6f} {z:.6f}' springref='0.015' "
            "stiffness='2000' damping='20'/><geom size='0.006' mass='0.02'/>"
            f"<body name='{name}'><joint name='spin_{k}' axis='{axle}'/>"
            f"<geom type='cylinder' size='0.025' fromto='{ends}' mass='0.05'/></body></body>"
        )
    motors = "".join(
        f"<velocity name='{name}' joint='spin_{k}' kv='2'/>" for k, name in enumerate(MOTORS)
    )
    return (
        "<mujoco><option integrator='implicitfast' cone='elliptic' impratio='10'/><worldbody>"
        f"{more}<body name='{HULL}' pos='0 0 0.2'><freejoint name='root'/>"
        "<geom type='capsule' size='0.02' fromto='-0.05 0 0 0.05 0 0' mass='0.5'/>"
        "<camera name='eye' pos='0.072 0 0' xyaxes='0 -1 0 0 0 1' fovy='75'/>"
        f"{''.join(arms)}</body></worldbody>"
        f"{f'<actuator>{motors}</actuator>' if driven else ''}</mujoco>"
    )


class Cruise:
    """A controller: 0.1 m/s after a ramp of 0.2 s."""

    def __init__(self, setup):
        self.setup, self.time = setup, 0.0

    def step(self, observation):
        self.time += self.setup.period
        speed = 4.0 * min(self.time / 0.2, 1.0)
        return ot.Actuation(np.full((self.setup.n, self.setup.model.nu), speed))


def crawl(folder: Path, seconds: float = 1.0, driven: bool = True, **changes) -> ot.Result:
    """The run of the crawler in a pipe that stands, with an elbow 0.5 m above its foot."""
    file = folder / "crawler.xml"
    file.write_text(crawler_xml(driven))
    robot = {"kind": "mjcf", "file": str(file), "forward": "x", "bore": 0.16}
    changes = {f"robot.{key}": value for key, value in robot.items()} | changes
    pipes = [
        {"kind": "straight", "name": "vertical_riser", "length": 0.5},
        {"kind": "elbow", "name": "knee", "mean_radius": 0.24},
        {"kind": "straight", "name": "level", "length": 0.4},
    ]
    plain = {"name": "crawler", "pipes": pipes, "robot": robot, "world": {"friction": 0.8}}
    plain["run"] = {"time_limit": seconds}
    scenario = ot.override(ot.Scenario.model_validate(plain), changes)
    return ot.run(scenario, controller=Cruise if driven else None)
