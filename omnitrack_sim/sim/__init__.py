"""Running scenarios: plant, recorder, monitor, runner, result."""
