"""Where a robot can go in towns and plants: its passport, and the map of its reach."""
