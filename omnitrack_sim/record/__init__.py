"""Records of runs as values: channels, trajectory, timeline, metrics, events, outcome."""
