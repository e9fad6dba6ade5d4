"""What lies ahead in the pipe, found in pictures of the camera at the robot's nose."""

from omnitrack_sim.autonomy.recognition.recogniser import Recogniser
from omnitrack_sim.autonomy.recognition.sighting import Motion, Sighting

__all__ = ["Motion", "Recogniser", "Sighting"]
