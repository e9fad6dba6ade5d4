"""The paper of the robot: its open-loop controllers, its claims made measurable, their figures."""
