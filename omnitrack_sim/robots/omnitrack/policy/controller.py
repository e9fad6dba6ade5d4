"""The controller that a policy file is: trained elsewhere, evaluated here in plain NumPy."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.table import FileName, Table
from omnitrack_sim.robots.omnitrack.control.interface import Command, ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.policy.base import joined
from omnitrack_sim.robots.omnitrack.policy.decisions import Decisions
from omnitrack_sim.robots.omnitrack.policy.file import Policy, load_policy


class PolicyTable(Table):
    """``[control.parameters]`` of the controller ``policy``."""

    policy: Annotated[str, Field(max_length=4096), FileName("sha256")]
    """A shipped policy by name, or a policy file, relative to the scenario."""
    sha256: Annotated[str | None, Field(validate_default=True)] = None
    """Of that file. Left out, it is filled in; another file than it says is refused, so that a
    saved run repeats itself or says why not."""

    @field_validator("policy")
    @classmethod
    def _can_be_read(cls, policy: str) -> str:
        try:
            load_policy(policy)
        except InputError as error:
            raise ValueError("; ".join(map(str, error.faults))) from None
        return policy

    @field_validator("sha256")
    @classmethod
    def _is_that_file(cls, sha256: str | None, info: ValidationInfo) -> str | None:
        if "policy" not in info.data:
            return sha256  # a fault that is told already
        found = load_policy(info.data["policy"]).sha256
        if sha256 not in (None, found):
            raise ValueError(f"the file has changed: it has {found}")
        return found


class PolicyController:
    """Asks the policy of each robot every decision period, and carries out what it says."""

    Parameters: ClassVar[type[Table]] = PolicyTable

    def __init__(self, setup: ControlSetup) -> None:
        names = [table.policy for table in setup.parameters]
        self._parts: list[tuple[np.ndarray, Policy, Decisions]] = []
        self._first: list[int] = []
        self.phases: tuple[str, ...] = ()
        for name in dict.fromkeys(names):
            policy = load_policy(name)
            decisions = Decisions(setup, policy.read, policy.acting)
            own = np.array([other == name for other in names])
            self._parts.append((own, policy, decisions))
            self._first.append(len(self.phases))
            self.phases += decisions.phases

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        commands = []
        for (own, policy, decisions), first in zip(self._parts, self._first, strict=True):
            if decisions.due.any():
                decisions.decide(policy(decisions.observe(observation)))
            command = decisions.command(observation)
            assert command.phase is not None
            commands.append((own, command._replace(phase=command.phase + first)))
        return joined(commands)
