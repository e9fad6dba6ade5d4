"""Replay pages of saved runs: one file of HTML each, which opens without a network."""

from omnitrack_sim.replay.write import write_replay

__all__ = ["write_replay"]
