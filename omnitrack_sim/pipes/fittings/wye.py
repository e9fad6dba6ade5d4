"""A wye: a run with an oblique branch of equal or smaller bore; at 90 degrees the reducing tee."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    FittingTable,
    check,
    fill_in,
    in_bores,
    lengthen,
    positive,
    possible_bore,
)
from omnitrack_sim.pipes.fittings.branched import Branched
from omnitrack_sim.pipes.fittings.wye_surface import EQUAL

ANGLES = (math.radians(30), math.radians(90))
"""Least and largest angle between branch and run, rad."""
MIN_ANGLE_DEG = 29.999999
"""Of files, degrees: 30 with room for what rounding makes of it."""
MIN_BRANCH = 0.4
"""Least diameter of the branch, in diameters of the run."""


@dataclass(frozen=True)
class Wye(Branched):
    """A run with a branch of equal or smaller bore that leans by ``angle`` rad from +z.

    The run is ``run_length`` m long, the branch ends ``branch_length`` m from the point where the
    axes meet.

    The rim's ``fillet_radius`` m is that of a ball that rolls inside the wall: the solid wall is
    opened by it.

    Example:
        >>> wye = ot.Wye(angle=1.05, branch_diameter=0.1)
        >>> wye.port_radius("branch")
        0.05
    """

    run_length: float = in_bores(2.75)
    branch_length: float = in_bores(1.375)
    angle: float = math.pi / 4
    fillet_radius: float = in_bores(1 / 32)
    inner_diameter: float = BORE
    branch_diameter: float = in_bores(1)
    kind: ClassVar[str] = "wye"

    class Table(FittingTable):
        """Keys in files."""

        run_length: Annotated[Size | None, Unit("m", "run")] = None
        """Along the run, at least as long as the rim asks for. Left out: 2.75 `inner_diameter`,
        0.44 m at 160 mm, or what the rim asks for."""
        branch_length: Annotated[Size | None, Unit("m", "branch")] = None
        """From the run's axis. Left out: 1.375 `inner_diameter`, 0.22 m at 160 mm, or what the rim
        asks for."""
        angle_deg: Annotated[float, Field(ge=MIN_ANGLE_DEG, le=90), Unit("deg", "")] = 45.0
        """Between the branch and the run towards `run_end`; 30 to 90."""
        fillet_radius: Annotated[Size | None, Unit("m")] = None
        """Of the rounded rim. Left out: 1/32 of `inner_diameter`, 5 mm at 160 mm."""
        branch_diameter: Annotated[Size | None, Unit("m")] = None
        """Of the branch, 0.4 to 1 of `inner_diameter`, which is the run's. Left out:
        `inner_diameter`."""

    def __post_init__(self) -> None:
        left_out = fill_in(self)
        run, branch, fillet = self.inner_diameter, self.branch_diameter, self.fillet_radius
        apart = run - branch
        check(
            self.kind,
            inner_diameter=possible_bore(run),
            angle=(
                ANGLES[0] - 1e-9 <= self.angle <= ANGLES[1] + 1e-9,
                f"is {math.degrees(self.angle):.6g} degrees; must be between 30 and 90",
            ),
            branch_diameter=(
                MIN_BRANCH * run <= branch * (1 + 1e-9) and apart >= -2 * EQUAL,
                f"is {branch} m; must be between {MIN_BRANCH * run:.6g} m and the run's {run} m",
            ),
            fillet_radius=(
                0 < fillet <= branch / 4,
                f"is {fillet} m; must be over 0 and at most a quarter of the branch's diameter",
            ),
            run_length=positive(self.run_length),
            branch_length=positive(self.branch_length),
        )
        # In a second check, since the lengths follow from an angle and radii that are valid by now.
        half, far = self.min_lengths
        lengthen(self, left_out, run_length=2 * half, branch_length=far)

    def bore_key(self, port: str) -> str:
        """See ``Fitting``."""
        return "branch_diameter" if port in self.branches else "inner_diameter"
