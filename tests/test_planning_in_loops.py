"""Planning of missions where it could go wrong or take long: loops, and many goals."""

import itertools
import random

import networkx
import pytest

from omnitrack_sim.autonomy import leg_planner as planning
from omnitrack_sim.autonomy.mission import Mission, MissionPlanner
from omnitrack_sim.pipes import route_through
from omnitrack_sim.pipes.network import Network, validate
from omnitrack_sim.pipes.planning import Leg, PathsToGoals, shortest_path
from omnitrack_sim.robots.omnitrack import Omnitrack

RAILS = (0.5, 0.7, 0.43, 0.61, 0.57)
"""Lengths of the straights between the rungs of the ladder, m."""


def _ladder(rungs: int) -> Network:
    """Two rails of tees, joined by rungs: every two neighbouring rungs close a loop. Both rails are
    open at both ends."""
    fittings, joints = [], []
    for rail in "ab":
        for k in range(rungs + 1):
            length = RAILS[k % len(RAILS)]
            fittings.append({"kind": "straight", "name": f"{rail}{k}", "length": length})
            if k < rungs:
                fittings.append({"kind": "tee", "name": f"t{rail}{k}"})
                joints.append({"ports": [f"{rail}{k}.end", f"t{rail}{k}.run_start"]})
            if k > 0:
                joints.append({"ports": [f"t{rail}{k - 1}.run_end", f"{rail}{k}.start"]})
    for k in range(rungs):
        fittings.append({"kind": "straight", "name": f"r{k}", "length": 0.6})
        joints.append({"ports": [f"ta{k}.branch", f"r{k}.start"]})
        joints.append({"ports": [f"r{k}.end", f"tb{k}.branch"]})
    return validate({"name": "ladder", "fittings": fittings, "joints": joints})


def _travel(legs: list[Leg] | None, at: float) -> float | None:
    """Travel back, counted along the way that is left, and on, m."""
    return None if legs is None else at - legs[-1].begin + legs[-1].end - legs[-1].begin


def _best_travel(
    plan: MissionPlanner, leg: Leg, at: float, goal: int, closed: list
) -> float | None:
    """Least travel, m, back and on to a goal, by trying every fitting of the way on its own with
    the routes laid in full."""
    old, best = plan.route(leg.path), []
    here = next((i for i, p in enumerate(old.passages) if at < p.s_leave), len(leg.path) - 1)
    for index, (part, enter, _) in enumerate(leg.path[: here + 1]):
        back = plan.network.joined_to.get(f"{plan.network.fittings[part].name}.{enter}")
        cut = [] if back is None else [((part, enter), plan.network.port(back))]
        graph = networkx.restricted_view(plan._graph, closed, cut)
        onward = shortest_path(graph, (part, enter), plan.ends[goal + 1])
        if onward is None:
            continue
        new = route_through(plan.network.pipes, (*leg.path[:index], *onward), plan.arcs)
        stand = min(at, _standing_place(new, index, plan.robot))
        nose_room = plan.robot.length / 2 + plan.robot.nose_room
        best.append(at - stand + new.centreline.length - nose_room - stand)
    return min(best, default=None)


def _standing_place(route, index: int, robot: Omnitrack) -> float:
    """Where the robot stands clear of fitting ``index`` and of what lies close before it, m."""

    def start(i: int) -> float:
        passage = route.passages[i]
        return passage.span[0] if passage.asks_orientation else passage.s_leave

    def over(i: int) -> float:
        return next((p.span[1] for p in route.passages[i::-1] if p.asks_orientation), -float("inf"))

    room, first = robot.standing_room, index
    while first > 0 and start(first) - over(first - 1) < robot.length + room:
        first -= 1
    return max(start(first) - robot.length / 2 - room, robot.length / 2)


def test_the_least_travel_is_found_in_a_network_of_loops():
    """On a ladder, with ports closed on the way, the planner's legs are as short as the best of all
    the ways that are tried one by one."""
    network, rng = _ladder(5), random.Random(3)
    ends, found = network.open_ends, 0
    for start, goal in [*itertools.permutations(ends, 2)] * 2:
        plan = MissionPlanner(network, Mission(start=start, goals=(goal,)), Omnitrack(), 0.1)
        leg, closed = plan.first, []
        for _ in range(3):
            at = rng.uniform(leg.begin, leg.end)
            closed.append(plan.obstacle(leg, at))
            legs = plan.replan(leg, at, 0, closed)
            expected = _best_travel(plan, leg, at, 0, closed)
            if legs is None:
                assert expected is None
                break
            assert _travel(legs, at) == pytest.approx(expected)
            leg, found = legs[-1], found + 1
    assert found > 20


def test_lengths_to_a_goal_are_those_of_the_shortest_ways():
    """For a port of any part, the way on that never turns round is as long as told, and where it
    comes to no port twice it is as long as the shortest way in the graph without turning back."""
    network = _ladder(3)
    plan = MissionPlanner(network, Mission(start="a0.start", goals=("b3.end",)), Omnitrack(), 0.1)
    to_go, compared = PathsToGoals(plan._graph, [plan.ends[1]]), 0
    for enter, length in to_go.lengths.items():
        way = to_go.path(enter)
        if way is None:
            continue
        back = network.joined_to.get(network.port_name(enter))
        cut = [] if back is None else [(enter, network.port(back))]
        graph = networkx.restricted_view(plan._graph, [], cut)
        for found in (way, shortest_path(graph, enter, plan.ends[1])):
            assert found is not None
            passed = [plan._graph[(i, p)][(i, q)]["length"] for i, p, q in found]
            assert length == pytest.approx(sum(passed))
        compared += 1
    assert compared > 20


def test_many_goals_ask_for_few_searches(monkeypatch):
    """A goal is planned with one search from the goal, and not with one for every fitting of the
    way: the time of a mission is linear in its goals and in the way."""
    searches = []
    original = planning.shortest_path
    monkeypatch.setattr(
        planning, "shortest_path", lambda *given: searches.append(1) or original(*given)
    )
    network = _ladder(6)
    goals = ("a6.end", "b6.end") * 20
    plan = MissionPlanner(network, Mission(start="a0.start", goals=goals), Omnitrack(), 0.1)
    assert plan.plan()[-1].goal == len(goals) - 1
    assert len(searches) <= len(goals)
