"""The paper, reproduced: every number, figure and observation as runs, a measured value and a
verdict.

``runs`` says what is simulated, ``theory``, ``driving`` and ``turning`` measure the claims,
``report`` makes the page.
"""

from omnitrack_sim.reproduce.claim import Claim
from omnitrack_sim.reproduce.command import reproduce

__all__ = ["Claim", "reproduce"]
