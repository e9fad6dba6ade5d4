"""The parameter table and the quantities derived from it."""

from typing import Annotated

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from omnitrack_sim.base.table import Unit
from omnitrack_sim.robots.kinds import ROBOTS, robot_class
from omnitrack_sim.robots.omnitrack import Motor, Omnitrack
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.tail import Tether


@pytest.mark.parametrize("kind", sorted(set(ROBOTS) - {"mjcf"}))
def test_no_value_of_a_robot_is_without_provenance(kind):
    """Each row of the table of any shipped robot says where its value comes from and, if it is a
    number, its unit; what is published says where."""
    for row in robot_class(kind)().parameters():
        assert row.provenance != "unstated", row
        assert row.source or row.name == "motor.source", row
        number = isinstance(row.value, int | float) and not isinstance(row.value, bool)
        assert row.unit or not number or row.name.endswith("motor.scale"), row


def test_a_field_that_says_nothing_of_its_source_is_unstated():
    """A robot of one's own may declare its fields plainly; the table shows what it lacks."""

    class Cart(Robot):
        bore: Annotated[float, Unit("m")] = 0.1
        """Of its pipe."""

        def spec(self) -> mujoco.MjSpec:
            return mujoco.MjSpec()

    (row,) = Cart().parameters()
    assert (row.unit, row.provenance, row.source) == ("m", "unstated", "Of its pipe.")


def test_a_robot_without_a_model_cannot_be_made():
    """``spec`` is what every robot has to bring; Python says so when one is made."""

    class Bare(Robot):
        bore: float = 0.1

    with pytest.raises(TypeError, match=r"abstract.*spec"):
        Bare()  # type: ignore[abstract]


def test_every_parameter_has_a_unit_and_a_provenance():
    """The table has a row for each field of the robot, of its motors and of its tether, each with a
    source."""
    rows = Omnitrack(roll_motor="simulation", tether={}).parameters()
    tables = {"motor": Motor, "roll_motor": Motor, "tether": Tether}
    names = [name for name in Omnitrack.model_fields if name not in tables]
    names += [f"{key}.{name}" for key, table in tables.items() for name in table.model_fields]
    assert sorted(row.name for row in rows) == sorted(names)
    assert all(row.source and row.provenance for row in rows)


def test_lug_radius_gives_the_published_speed():
    """r times the motor's no-load speed of 3.62 rad/s is the published 100 mm/s (Eq. 1)."""
    assert Omnitrack().lug_radius * 3.62 == pytest.approx(0.1, rel=2e-3)


def test_reach_follows_from_the_published_sector():
    """rho = R sqrt(1 + cos^2(96.54/2)) for a 90 degree turn."""
    reach = 0.080 * np.sqrt(1 + np.cos(np.radians(96.54 / 2)) ** 2)
    assert Omnitrack().reach == pytest.approx(reach, abs=1e-5)


def test_springs_add_up():
    """Four springs of 0.5 N/mm make 2 N/mm a module."""
    assert Omnitrack().module_stiffness == pytest.approx(2000.0)


def test_robot_is_frozen_and_refuses_unknown_fields():
    """A parameter cannot be set in place, and a misspelt one is an error."""
    with pytest.raises(TypeError, match="cannot be set"):
        Omnitrack().preload = 3.0
    with pytest.raises(ValidationError):
        Omnitrack(prelaod=3.0)
    with pytest.raises(ValidationError):
        Omnitrack(lug_radius=-0.01)


def test_its_nominal_speed_is_that_of_the_paper():
    """100 mm/s, in any bore: what courses and passports drive it with."""
    assert [Omnitrack(scale=scale).nominal_speed for scale in (1.0, 3.0)] == [0.1, 0.1]
