"""Learned controllers: what they observe, what they decide, and what comes of it."""

from omnitrack_sim.robots.omnitrack.policy.actions import (
    ACTINGS,
    ACTIONS,
    DECISION_PERIOD,
    DIRECT,
    RESIDUAL,
    Acting,
)
from omnitrack_sim.robots.omnitrack.policy.decisions import Decisions
from omnitrack_sim.robots.omnitrack.policy.feature import (
    Feature,
    View,
    bounds,
    entry_names,
    entry_slices,
)
from omnitrack_sim.robots.omnitrack.policy.features import FEATURE_SETS, FEATURES, features_of
from omnitrack_sim.robots.omnitrack.policy.file import Policy, load_policy, named_features
from omnitrack_sim.robots.omnitrack.policy.header import TrainingRecord
from omnitrack_sim.robots.omnitrack.policy.mlp import Mlp

__all__ = [
    "ACTINGS",
    "ACTIONS",
    "DECISION_PERIOD",
    "DIRECT",
    "FEATURES",
    "FEATURE_SETS",
    "RESIDUAL",
    "Acting",
    "Decisions",
    "Feature",
    "Mlp",
    "Policy",
    "TrainingRecord",
    "View",
    "bounds",
    "entry_names",
    "entry_slices",
    "features_of",
    "load_policy",
    "named_features",
]
