"""Parameters of a scenario and its robot from logs of runs, with their doubt."""
