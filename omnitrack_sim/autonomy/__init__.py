"""From what sensors tell to where the robot is, what its pipes are, and where it goes next."""
