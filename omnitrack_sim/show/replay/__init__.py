"""Replay pages of saved runs: one file of HTML each, which opens without a network."""

from omnitrack_sim.show.replay.write import ReplayPage, show_replay, write_replay

__all__ = ["ReplayPage", "show_replay", "write_replay"]
