"""What a run leaves behind as values: trajectory, timeline, metrics, outcome."""
