"""An equal tee: a wye whose branch is square to the run, and as wide."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    FittingTable,
    check,
    fill_in,
    in_bores,
    possible_bore,
)
from omnitrack_sim.pipes.fittings.branched import Branched


@dataclass(frozen=True)
class Tee(Branched):
    """An equal tee: a wye of 90 degrees with a branch as wide as its run.

    The run is ``run_length`` m long, the branch ends ``branch_length`` m from the run's axis.

    The rim's ``fillet_radius`` m is that of a ball that rolls inside the wall: the solid wall is
    opened by it.

    Example:
        >>> ot.Tee().describe("run_start", "branch").words
        'run to branch'
    """

    run_length: float = in_bores(2)
    branch_length: float = in_bores(1)
    fillet_radius: float = in_bores(1 / 32)
    inner_diameter: float = BORE
    angle: float = field(default=math.pi / 2, init=False, repr=False)
    branch_diameter: float = field(init=False, repr=False)
    kind: ClassVar[str] = "tee"

    class Table(FittingTable):
        """Keys in files."""

        run_length: Annotated[Size | None, Unit("m", "run")] = None
        """Along the run. Left out: 2 `inner_diameter`, 0.32 m at 160 mm."""
        branch_length: Annotated[Size | None, Unit("m", "branch")] = None
        """From the run's axis. Left out: `inner_diameter`."""
        fillet_radius: Annotated[Size | None, Unit("m")] = None
        """Of the rounded rim. Left out: 1/32 of `inner_diameter`, 5 mm at 160 mm."""

    def __post_init__(self) -> None:
        fill_in(self)
        object.__setattr__(self, "branch_diameter", self.inner_diameter)
        least = self.inner_diameter / 2 + max(self.fillet_radius, 0.0)
        check(
            self.kind,
            inner_diameter=possible_bore(self.inner_diameter),
            fillet_radius=(
                0 < self.fillet_radius <= self.inner_diameter / 4,
                f"is {self.fillet_radius} m; must be over 0 and at most a quarter of the diameter",
            ),
            run_length=(
                self.run_length / 2 >= least,
                f"is {self.run_length} m; must be at least {2 * least} m",
            ),
            branch_length=(
                self.branch_length >= least,
                f"is {self.branch_length} m; must be at least {least} m",
            ),
        )
