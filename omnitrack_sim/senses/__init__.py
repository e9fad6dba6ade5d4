"""Sensors: functions from the state of the physics to measured quantities."""

from omnitrack_sim.senses.sensor import SENSORS, Sensor, State

__all__ = ["SENSORS", "Sensor", "State"]
