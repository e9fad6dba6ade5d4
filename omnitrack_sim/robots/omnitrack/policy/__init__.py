"""Learned controllers: what they observe, what they decide, and what comes of it."""

from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import (
    ACTIONS,
    FEATURE_SETS,
    FEATURES,
    Feature,
    FeatureInput,
    bounds,
    entry_slices,
    features_of,
)
from omnitrack_sim.robots.omnitrack.policy.file import (
    ACTINGS,
    DECISION_PERIOD,
    DIRECT,
    RESIDUAL,
    Acting,
    Mlp,
    Policy,
    TrainingRecord,
    load_policy,
    named_features,
)

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
    "FeatureInput",
    "Mlp",
    "Policy",
    "TrainingRecord",
    "bounds",
    "entry_slices",
    "features_of",
    "load_policy",
    "named_features",
]
