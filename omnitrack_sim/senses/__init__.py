"""Sensors: functions from the state of the physics to measured quantities."""

from omnitrack_sim.senses.sensor import Sensor, State
from omnitrack_sim.senses.truth import SENSORS

__all__ = ["SENSORS", "Sensor", "State"]
