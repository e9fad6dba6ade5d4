"""Tables of the routes of a batch: what is looked up along them is what their passages say."""

from __future__ import annotations

import math

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.pipes.fittings.kinds import fitting_class
from omnitrack_sim.pipes.route_map import RouteMap

ELBOW = ot.Step(
    "e", fitting_class("elbow")(mean_radius=0.2, angle=math.radians(30)), "start", "end"
)


def wye(leave: str, angle: float = 45.0, enter: str = "run_start") -> ot.Step:
    return ot.Step("wye", fitting_class("wye")(angle=math.radians(angle)), enter, leave)


def through(*steps: ot.Step) -> ot.Route:
    """A route through fittings, each between straights."""
    straight = fitting_class("straight")
    whole = [ot.Step("s0", straight(length=0.5), "start", "end")]
    for k, step in enumerate(steps, 1):
        whole += [step, ot.Step(f"s{k}", straight(length=0.4), "start", "end")]
    return ot.route(whole)


def routes() -> list[ot.Route]:
    """Over and into branches of several angles, by elbows, out of branches; one without any."""
    tee = fitting_class("tee")
    return [
        through(wye("branch"), ELBOW),
        through(wye("run_end")),
        through(),
        through(ot.Step("t", tee(), "branch", "run_end"), wye("run_end", 60.0, "branch")),
        through(
            ot.Step("t", tee(), "run_start", "run_end"), ot.Step("u", tee(), "run_end", "branch")
        ),
    ]


def test_each_passage_has_its_row_and_each_route_one_more():
    """In the order of the routes; what comes after a route's last fitting is at infinity."""
    known, made = routes(), RouteMap(routes())
    row = 0
    for number, route in enumerate(known):
        asking = [p for p in route.passages if p.asks_orientation]
        assert made.first[number] == row
        assert made.count[number] == len(asking) + 1
        assert (made.route_of[row : row + len(asking) + 1] == number).all()
        for passage in asking:
            about = passage.description
            assert (made.start[row], made.end[row]) == passage.span
            assert made.is_turn[row] == passage.is_turn
            assert made.is_tee_turn[row] == (passage.manoeuvre == "tee_turn")
            assert made.is_straight_over[row] == (passage.manoeuvre == "tee_straight")
            assert (made.into_branch[row], made.out_of_branch[row]) == (
                about.into_branch,
                about.out_of_branch,
            )
            assert made.radius[row] == passage.radius
            assert made.corner_radius[row] == passage.corner_radius
            turn = about.turn_angle if passage.is_turn else math.pi / 2
            assert made.turn[row] == pytest.approx(turn)
            np.testing.assert_allclose(made.directions[row], passage.turn_direction)
            tangent = route.centreline.frame(np.array([passage.span[0]]))[0, :, 2]
            np.testing.assert_allclose(made.ahead[row], tangent, atol=1e-12)
            bends = np.isfinite(made.bend_radius[row])
            assert bends == np.isfinite(passage.bend_radius)
            if bends:
                assert made.bend_radius[row] == passage.bend_radius
                assert made.sharpness[row] == pytest.approx(passage.radius / passage.bend_radius)
            else:
                assert made.sharpness[row] == 0
            row += 1
        assert made.last[number] == row
        assert np.isinf([made.start[row], made.end[row]]).all()
        assert not made.is_turn[row]
        assert made.radius[row] == route.passages[-1].radius
        end = route.centreline.frame(np.array([route.centreline.length]))[0, :, 0]
        np.testing.assert_allclose(made.directions[row], end)
        row += 1
    assert len(made.passages) == row


@pytest.mark.parametrize(
    ("step", "degrees"),
    [
        (wye("branch"), 45),
        (wye("branch", 60.0), 60),
        (wye("branch", 60.0, "run_end"), 120),
        (ELBOW, 30),
        (ot.Step("t", fitting_class("tee")(), "run_start", "branch"), 90),
    ],
)
def test_a_turn_is_by_the_angle_between_its_ports(step, degrees):
    """Of the ways there before and behind it, whatever the fitting."""
    made = RouteMap([through(step)])
    assert np.degrees(made.turn[0]) == pytest.approx(degrees)


def test_routes_that_are_added_keep_the_numbers_of_those_before():
    """All at once or one by one, tables are the same, and the version counts the times."""
    one, together = RouteMap(), RouteMap(routes())
    for route in routes():
        one.add([route])
    assert (one.version, together.version) == (len(routes()), 1)
    for name in ("first", "count", "last", "route_of", "start", "turn", "directions", "radius"):
        np.testing.assert_array_equal(getattr(one, name), getattr(together, name))


def test_theta5_of_a_bend_behind_is_told_by_its_end():
    """A robot in the second of two bends in other planes keeps its angle in the plane of the first.

    However far it is beyond: the first bend's direction at its end counts, not the second's.
    """
    bend = fitting_class("elbow")
    route = ot.route(
        [
            ot.Step("s", fitting_class("straight")(length=0.5), "start", "end"),
            ot.Step("a", bend(mean_radius=0.2, angle=math.radians(60)), "start", "end"),
            ot.Step(
                "b", bend(mean_radius=0.2, angle=math.radians(60)), "start", "end", math.pi / 2
            ),
        ]
    )
    made, first = RouteMap([route]), np.zeros(1, int)
    end = np.array([made.end[0]])
    _, rotation = made.start_poses(first, end - 1e-6, np.array([0.7]))
    for s in (end - 1e-6, end, end + 1e-6, end + 0.05):
        position, _ = made.start_poses(first, s, np.zeros(1))
        here = made.locate(position, rotation, first, s)
        assert made.theta5(here, first) == pytest.approx(0.7, abs=1e-4)
