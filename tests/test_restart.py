"""Robots of a running batch that begin anew: the same bytes as a simulation of their own."""

from __future__ import annotations

import numpy as np
import pytest
from runs import there_and_back

import omnitrack_sim as ot
from omnitrack_sim.sim.onboard import Onboard


def tee(**changes: object) -> ot.Scenario:
    """A tee turn of at most 1.5 s, with exact walls."""
    return ot.override(ot.load_scenario("tee_turn"), {"run.time_limit": 1.5} | changes)


def onboard() -> ot.Scenario:
    """A tee turn by own sensors, with pictures ten times a second."""
    return tee(**{"sensing.kind": "onboard"})


def changed(base: ot.Scenario, number: int) -> ot.Scenario:
    """The same pipes with other friction, preload, mass, motors, gravity, orientation, speed."""
    return ot.override(
        base,
        {
            "world.friction": 0.5 + 0.05 * number,
            "robot.preload": 10.0 + number,
            "robot.chassis_mass": 0.2 + 0.03 * number,
            "robot.motor.rotor_inertia": 8e-9 + 2e-10 * number,
            "robot.motor.efficiency": 1.0 - 0.05 * number,
            "world.gravity": [0.5 * number, 0.0, -9.0],
            "start.theta5_deg": 10.0 * number,
            "start.distance": 0.1 + 0.01 * number,
            "control.cruise_speed": 0.08 + 0.01 * number,
        },
    )


def seen(simulation: ot.Simulation, robot: int) -> bytes:
    """All that a robot is told, and what the monitor and the motors keep of it."""
    observation, location = simulation.observation, simulation.location
    arrays = [simulation.plant.qpos[robot], simulation.plant.motors._correction[robot]]
    arrays += [simulation.readings[name][robot] for name in ("slip_ratio", "contact_position")]
    arrays += [observation.motor_torque[robot], observation.time[robot], location.distance[robot]]
    arrays += [simulation.monitor._diagnosis.mean[robot], simulation.monitor._waiting[robot]]
    arrays += [observation.angular_velocity[robot], observation.location.distance[robot]]
    senses = simulation.senses
    if isinstance(senses, Onboard):
        arrays += [senses.localiser.filter.covariance[robot], senses.localiser.misfit[robot]]
        arrays += [senses.picture[robot]]
    return b"".join(np.asarray(array).tobytes() for array in arrays)


def drive(simulation: ot.Simulation, steps: int, robot: int, speeds: np.ndarray) -> list[bytes]:
    """What a robot is told at each step while all are asked for ``speeds`` (steps, 3) m/s."""
    told = [seen(simulation, robot)]
    for asked in speeds[:steps]:
        command = np.zeros((simulation.n, 3))
        command[robot] = asked
        simulation.step(ot.Command(command))
        told.append(seen(simulation, robot))
    return told


@pytest.fixture(scope="module")
def speeds() -> np.ndarray:
    """Belt speeds (60, 3) m/s."""
    return np.random.default_rng(1).uniform(0.0, 0.15, (60, 3))


@pytest.mark.parametrize("make", [tee, there_and_back, onboard], ids=["tee", "mission", "onboard"])
@pytest.mark.parametrize("steps", [7, 20], ids=["odd", "even"])
def test_a_robot_begins_anew_to_the_bytes_of_its_own_simulation(make, steps, speeds) -> None:
    """Whatever it did before, and whatever its neighbours do."""
    base = make()
    simulation = ot.Simulation([changed(base, k) for k in range(3)], recording=False)
    drive(simulation, steps, 1, -speeds)
    simulation.reset([1], [changed(base, 5)])
    alone = ot.Simulation([changed(base, 5)], recording=False)
    assert drive(simulation, 60, 1, speeds) == drive(alone, 60, 0, speeds)


@pytest.mark.parametrize("make", [tee, onboard])
def test_the_others_go_on_as_if_nothing_had_happened(make, speeds) -> None:
    """To the last bit."""
    scenarios = [changed(make(), k) for k in range(3)]
    calm, disturbed = (ot.Simulation(scenarios, recording=False) for _ in range(2))
    expected = drive(calm, 30, 0, speeds)
    told = drive(disturbed, 9, 0, speeds)
    disturbed.reset([1, 2], [changed(make(), 7), changed(make(), 8)])
    assert told + drive(disturbed, 21, 0, speeds[9:])[1:] == expected


def test_a_robot_whose_run_is_over_runs_again(speeds) -> None:
    """One that has run out of time, and one whose physics has gone wrong."""
    brief = tee(**{"run.time_limit": 0.05})
    simulation = ot.Simulation([brief, tee()], recording=False)
    simulation.plant._batch.bind("qvel")[1, 0] = 1e12
    drive(simulation, 5, 0, speeds)
    ended = [ending.outcome for ending in simulation.endings if ending is not None]
    assert ended == [ot.Outcome.TIMED_OUT, ot.Outcome.DIVERGED]
    simulation.reset([0, 1], [tee(), tee()])
    assert simulation.endings == [None, None]
    for robot in (0, 1):
        new = [changed(tee(), 1), changed(tee(), 2)]
        simulation.reset([0, 1], new)
        alone = ot.Simulation([new[robot]], recording=False)
        assert drive(simulation, 20, robot, speeds) == drive(alone, 20, 0, speeds)


def test_speed_and_time_limit_are_those_of_the_new_run(speeds) -> None:
    """The settings that a controller would be given, and when the run is over."""
    simulation = ot.Simulation([tee(), tee()], recording=False)
    fast = tee(**{"control.cruise_speed": 0.12, "run.time_limit": 0.03})
    simulation.reset([1], [fast])
    assert simulation.setup.settings.cruise_speed.tolist() == [0.1, 0.12]
    drive(simulation, 4, 1, speeds)
    assert simulation.active.tolist() == [True, False]
    assert simulation.end_time[1] == pytest.approx(0.03)


def test_what_is_recorded_does_not_begin_anew() -> None:
    """A record is of one run."""
    with pytest.raises(RuntimeError, match="not recorded"):
        ot.Simulation([tee()]).reset([0], [tee()])


def test_without_a_record_there_are_no_results(speeds) -> None:
    """And nothing is kept."""
    simulation = ot.Simulation([tee(**{"run.time_limit": 0.03})], recording=False)
    simulation.advance()
    assert simulation.recorder.count == 0
    with pytest.raises(RuntimeError, match="nothing was recorded"):
        simulation.results()


def test_looks_begin_anew() -> None:
    """A robot that has looked about before it began anew sees what one of its own simulation does,
    noise of the cameras included; a further look has other noise."""
    several = ot.Simulation([changed(onboard(), k) for k in range(2)], recording=False)
    several.senses.look(1, back=False)
    several.reset([1], [changed(onboard(), 5)])
    alone = ot.Simulation([changed(onboard(), 5)], recording=False)
    looks = [str(several.senses.look(1, back=False)), str(alone.senses.look(0, back=False))]
    assert looks[0] == looks[1]
    assert str(alone.senses.look(0, back=False)) != looks[1]
