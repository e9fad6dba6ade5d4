"""The paper of the robot: its claims made measurable, their figures."""
