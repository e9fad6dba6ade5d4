"""omnitrack_sim: the Omnidirectional Tractable Three Module Robot in pipes, on MuJoCo.

Names are loaded on first use, so that ``import omnitrack_sim`` stays light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omnitrack_sim.control.interface import Command, Controller, ControlSetup, Observation
    from omnitrack_sim.control.policy import Feature, Policy, load_policy
    from omnitrack_sim.drive import DRIVES, Drive
    from omnitrack_sim.errors import (
        GeometryError,
        InputError,
        NetworkError,
        OmnitrackError,
        OutputError,
        PolicyError,
        RenderError,
        ScenarioError,
        StudyError,
        SweepError,
    )
    from omnitrack_sim.film.render import render_frame, render_video
    from omnitrack_sim.film.strip import render_strip
    from omnitrack_sim.network import (
        Ahead,
        MapDifference,
        Network,
        compare_maps,
        load_network,
        random_network,
        shortest_route,
    )
    from omnitrack_sim.optimise import Study, StudyResult, load_study, run_study
    from omnitrack_sim.pipes import Assembly, Elbow, Reducer, Step, Straight, Tee, route
    from omnitrack_sim.plots import (
        plot_channel,
        plot_compare,
        plot_mission,
        plot_network,
        plot_singularity,
        plot_summary,
    )
    from omnitrack_sim.record.channels import Channel
    from omnitrack_sim.record.events import Event, Remark
    from omnitrack_sim.record.metrics import Metric
    from omnitrack_sim.record.outcome import Outcome
    from omnitrack_sim.record.timeline import Visit
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.replay import ReplayPage, show_replay, write_replay
    from omnitrack_sim.robot import MOTORS, Motor, Robot
    from omnitrack_sim.scenario import Scenario, load_scenario, override
    from omnitrack_sim.schema.shipped import (
        shipped_networks,
        shipped_policies,
        shipped_scenarios,
        shipped_studies,
        shipped_sweeps,
    )
    from omnitrack_sim.sensing import Sensor
    from omnitrack_sim.sim.comparison import Comparison, compare
    from omnitrack_sim.sim.loading import load_result
    from omnitrack_sim.sim.result import Result
    from omnitrack_sim.sim.run import run, run_batch
    from omnitrack_sim.sim.simulation import Simulation
    from omnitrack_sim.sweep import Sweep, load_sweep, plot_sweep, run_sweep
    from omnitrack_sim.theory.singularity import TurnCase

__version__ = "0.1.0"

_HOME = {
    "drive": ("DRIVES", "Drive"),
    "errors": (
        "GeometryError",
        "InputError",
        "NetworkError",
        "OmnitrackError",
        "OutputError",
        "PolicyError",
        "RenderError",
        "ScenarioError",
        "StudyError",
        "SweepError",
    ),
    "schema.shipped": (
        "shipped_networks",
        "shipped_policies",
        "shipped_scenarios",
        "shipped_studies",
        "shipped_sweeps",
    ),
    "network": (
        "Ahead",
        "MapDifference",
        "Network",
        "compare_maps",
        "load_network",
        "random_network",
        "shortest_route",
    ),
    "record.outcome": ("Outcome",),
    "pipes": ("Elbow", "Assembly", "Reducer", "Step", "Straight", "Tee", "route"),
    "plots": (
        "plot_channel",
        "plot_compare",
        "plot_mission",
        "plot_network",
        "plot_singularity",
        "plot_summary",
    ),
    "film.render": ("render_frame", "render_video"),
    "film.strip": ("render_strip",),
    "replay": ("ReplayPage", "show_replay", "write_replay"),
    "robot": ("MOTORS", "Motor", "Robot"),
    "scenario": ("Scenario", "load_scenario", "override"),
    "sim.comparison": ("Comparison", "compare"),
    "sim.loading": ("load_result",),
    "sim.result": ("Result",),
    "sim.run": ("run", "run_batch"),
    "sim.simulation": ("Simulation",),
    "control.policy": ("Feature", "Policy", "load_policy"),
    "control.interface": ("Command", "ControlSetup", "Controller", "Observation"),
    "record.channels": ("Channel",),
    "record.events": ("Event", "Remark"),
    "record.metrics": ("Metric",),
    "sensing": ("Sensor",),
    "theory.singularity": ("TurnCase",),
    "optimise": ("Study", "StudyResult", "load_study", "run_study"),
    "sweep": ("Sweep", "load_sweep", "plot_sweep", "run_sweep"),
    "record.timeline": ("Visit",),
    "record.trajectory": ("Trajectory",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "DRIVES",
    "MOTORS",
    "Ahead",
    "Assembly",
    "Channel",
    "Command",
    "Comparison",
    "ControlSetup",
    "Controller",
    "Drive",
    "Elbow",
    "Event",
    "Feature",
    "GeometryError",
    "InputError",
    "MapDifference",
    "Metric",
    "Motor",
    "Network",
    "NetworkError",
    "Observation",
    "OmnitrackError",
    "Outcome",
    "OutputError",
    "Policy",
    "PolicyError",
    "Reducer",
    "Remark",
    "RenderError",
    "ReplayPage",
    "Result",
    "Robot",
    "Scenario",
    "ScenarioError",
    "Sensor",
    "Simulation",
    "Step",
    "Straight",
    "Study",
    "StudyError",
    "StudyResult",
    "Sweep",
    "SweepError",
    "Tee",
    "Trajectory",
    "TurnCase",
    "Visit",
    "compare",
    "compare_maps",
    "load_network",
    "load_policy",
    "load_result",
    "load_scenario",
    "load_study",
    "load_sweep",
    "override",
    "plot_channel",
    "plot_compare",
    "plot_mission",
    "plot_network",
    "plot_singularity",
    "plot_summary",
    "plot_sweep",
    "random_network",
    "render_frame",
    "render_strip",
    "render_video",
    "route",
    "run",
    "run_batch",
    "run_study",
    "run_sweep",
    "shipped_networks",
    "shipped_policies",
    "shipped_scenarios",
    "shipped_studies",
    "shipped_sweeps",
    "shortest_route",
    "show_replay",
    "write_replay",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
