"""``python -m omnitrack_sim.cli``."""

from omnitrack_sim.cli import main

main()
