"""Laws of exploring, on random networks: with fittings close together, wyes, reducers and loops."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from noisy_senses import CameraErrors
from point_robot import Errors, PointRobot

from omnitrack_sim.pipes.map_difference import MapDifference, compare_maps
from omnitrack_sim.pipes.network import Network, validate
from omnitrack_sim.record.events import EndInspected, ExplorationComplete, ExplorationIncomplete

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from explorations import LOOPS, loop, tree

TRAVEL = 3.5
"""Exploration travel budget, in network lengths."""


class Falls(Errors):
    """A robot that falls in some fittings, and else errs in nothing."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def falls(self) -> bool:
        """See ``Errors``."""
        return bool(self._rng.random() < 0.1)


class Exploration:
    """One exploration of a random network, with a plate before some of its ends.

    Attributes:
        robot: when it is over.
        network: the true one.
        complete: the robot claims to have explored all.
        home: it is back at the start.
        difference: of its map.
    """

    def __init__(self, seed: int, errors: Errors | None = None) -> None:
        rng = np.random.default_rng([seed, 4])
        self.network = loop(rng) if rng.random() < LOOPS else tree(seed, rng)
        start = str(rng.choice(list(self.network.open_ends)))
        ends = [port for port in self.network.open_ends if port != start]
        plates = [str(rng.choice(ends))] if rng.random() < 0.3 else []
        self.robot = PointRobot(self.network, start, seen=plates, arms=True, errors=errors)
        self.robot.run(2 * TRAVEL * self.network.length)
        events = self.robot.events
        self.complete = any(isinstance(event, ExplorationComplete) for event in events)
        doubts = any(isinstance(event, ExplorationIncomplete) for event in events)
        self.home = self.complete or doubts
        self.difference: MapDifference = compare_maps(
            self.robot.explorer.belief.network, self.network, start, plates
        )

    @property
    def map(self) -> Network:
        """That of the robot."""
        return self.robot.explorer.belief.network


@pytest.mark.parametrize("seed", range(60000, 60012))
def test_by_error_free_sight_the_map_is_the_network(seed):
    """Each end is inspected once, all is called complete, and the robot is home within its travel;
    it drives no sharp turn where there is another way, and the map is a valid file."""
    done = Exploration(seed)
    assert done.difference.same, done.difference
    assert done.difference.length_error < 1e-3
    assert done.complete
    inspected = [event.port for event in done.robot.events if isinstance(event, EndInspected)]
    assert len(set(inspected)) == len(inspected) == len(done.robot.explorer.belief.explored)
    assert done.robot.explorer.leg.path[-1][::2] == done.robot.explorer.belief.start
    assert done.robot.travel < TRAVEL * done.network.length
    assert validate(done.map.model_dump(mode="json")) == done.map


@pytest.mark.parametrize("seed", range(61000, 61008))
def test_a_robot_that_falls_now_and_then_has_the_right_map_as_well(seed):
    """It comes home, and what it has given up for its falls it names."""
    done = Exploration(seed, Falls(seed))
    assert done.home
    assert done.complete == done.difference.same == (not done.robot.explorer.unexplored)
    assert done.robot.travel < 2 * TRAVEL * done.network.length


def test_by_depth_camera_nearly_all_maps_are_right_and_none_that_is_wrong_is_called_complete():
    """Of 12 networks, with errors of pictures, belts and arms as measured by physics; lengths are
    right to some millimetres each."""
    tours = [Exploration(seed, CameraErrors(seed)) for seed in range(62000, 62012)]
    assert all(tour.home for tour in tours)
    assert sum(tour.difference.same for tour in tours) >= 11
    assert not [tour for tour in tours if tour.complete and not tour.difference.same]
    assert sum(tour.complete for tour in tours) >= 6
    assert np.median([tour.difference.length_error for tour in tours]) < 0.025


def test_standard_deviations_that_a_robot_states_are_those_of_its_errors():
    """Of sizes by a depth camera, normalised: most errors are within two, and they are not much
    greater than the errors are."""
    tours = [Exploration(seed, CameraErrors(seed)) for seed in range(63000, 63008)]
    errors = [
        size.error / size.std
        for tour in tours
        for size in compare_maps(tour.map, tour.network, stds=tour.robot.explorer.belief.stds).sizes
        if size.std and size.error is not None
    ]
    assert len(errors) > 50
    assert np.mean(np.abs(errors) < 2) > 0.9
    assert 0.3 < np.sqrt(np.mean(np.square(np.clip(errors, -4, 4)))) < 1.3


@pytest.mark.parametrize("seed", range(64000, 64008))
def test_by_headlight_an_exploration_ends_and_leaves_nothing_out_unsaid(seed):
    """The robot comes home, and a map that lacks a part is not called complete."""
    done = Exploration(seed, CameraErrors(seed, lamp=True))
    assert done.home
    assert done.difference.complete or not done.complete
    assert done.robot.travel < TRAVEL * done.network.length


def test_an_exploration_is_the_same_each_time():
    """Looks, events and map, to the last digit."""
    one, other = (Exploration(65000, CameraErrors(7)) for _ in range(2))
    assert [str(event) for event in one.robot.events] == [str(e) for e in other.robot.events]
    assert one.map == other.map
    assert one.robot.travel == other.robot.travel
