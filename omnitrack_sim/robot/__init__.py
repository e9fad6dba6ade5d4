"""The robot as data: its parameters, its crawler motors and their drive."""

from omnitrack_sim.robot.parameters import MODULE_ANGLES, MODULES, Parameter, Quantity, Robot

__all__ = ["MODULES", "MODULE_ANGLES", "Parameter", "Quantity", "Robot"]
