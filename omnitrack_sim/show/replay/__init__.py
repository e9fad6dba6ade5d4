"""Replay pages of saved runs: one file of HTML each, which opens without a network."""
