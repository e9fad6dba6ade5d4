"""One folder a robot: its data, body, motors, kinematics and control law."""
