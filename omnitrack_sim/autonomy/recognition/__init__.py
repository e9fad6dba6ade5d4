"""Recognition of what lies ahead in the pipe, from pictures of the camera at the robot's nose."""

from omnitrack_sim.autonomy.recognition.forms import Detection
from omnitrack_sim.autonomy.recognition.recogniser import Recogniser

__all__ = ["Detection", "Recogniser"]
