"""The paper, reproduced: its statements as runs, measured values and verdicts.

A statement is a number, a figure or an observation of the paper.

``runs`` says what is simulated; ``theory``, ``driving``, ``elbows`` and ``tees`` measure the claims
with what ``readings`` has in common for them; ``report`` makes the page.
"""

from omnitrack_sim.reproduce.claim import Claim, Verdict
from omnitrack_sim.reproduce.command import reproduce

__all__ = ["Claim", "Verdict", "reproduce"]
