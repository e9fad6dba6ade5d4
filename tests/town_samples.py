"""Passports of a made-up robot, whose probabilities are known."""

import numpy as np

import omnitrack_sim as ot
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings
from omnitrack_sim.towns.features import FEATURES
from omnitrack_sim.towns.passage_model import KindTrials

WAYS = ("run to branch", "branch to run", "over the run", "across the run")
KINDS = (
    *("straight", "elbow", "mitre", "reducer"),
    *(f"{kind}, {way}" for kind in ("tee", "wye", "cross") for way in WAYS),
    *("coupling", "straight, relief"),
)
assert {kind.partition(",")[0] for kind in KINDS} | {"cap"} == {*shipped_fittings()}
LARGEST = {"step": 0.05, "gap": 0.4, "ovality": 0.1, "deposit": 0.2}
"""Sizes up to which couplings and relief were tried."""


def passport(rates=None, trials=400, speed=0.1, robot="presser", pull=0.0):
    """A passport in which each kind passes at the rate given for it, 1 without, at any point; a
    pull of so many robot weights halves it."""
    rng, kinds = np.random.default_rng(1), {}
    for kind in KINDS:
        turn = 90 if "branch" in kind or kind in ("elbow", "mitre") else 0
        sharpness = {"elbow": 2 / 3, "reducer": 0.03}.get(kind, 0.0)
        low = [0.3, 0, -1, -1, turn, sharpness, 1]
        high = [1.0, 6, 1, 1, turn, sharpness, 1]
        x = rng.uniform(low, high, (trials, len(low)))
        x = np.pad(x, ((0, 0), (0, len(FEATURES) - len(low))))
        if kind in KINDS[-2:]:
            for name, most in LARGEST.items():
                x[:, FEATURES.index(name)] = rng.uniform(0, most, trials)
        rate = np.full(trials, (rates or {}).get(kind, 1.0))
        if pull:
            rate = rate / (1 + np.exp(4 * (x[:, 1] - pull)))
        passed = (rng.uniform(size=trials) < rate).astype(float)
        costs = np.tile([1 / speed, 2.0, 0.001], (trials, 1))
        costs[:, 0] += rng.normal(0, 0.1, trials)
        kinds[kind] = KindTrials(
            x, passed, np.where(passed[:, None] == 1, costs, np.nan), ["stuck"] * trials
        )
    return ot.Passport(ot.load_scenario(f"robots/{robot}_elbow").robot, {}, kinds)
