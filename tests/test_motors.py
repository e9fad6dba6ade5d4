"""Motors as values: the shipped ones, a scenario's own, and where their figures end up."""

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.robots.quantity import quantity_of
from omnitrack_sim.scenario import validate

PIPES = [{"kind": "straight", "length": 0.8}]
OWN = {
    "name": "small",
    "gear_ratio": 250.0,
    "rotor_inertia": 4e-9,
    "no_load_speed": 12.0,
    "stall_torque": 0.6,
    "torque_limit": 0.3,
}


def _scenario(**robot) -> ot.Scenario:
    return validate({"pipes": PIPES, "robot": robot})


def test_shipped_motors_reflect_the_inertia_they_always_had():
    """J ratio² is 0.0088 kg m² to the last bit, on which every earlier trajectory rests."""
    assert {name: motor.reflected_inertia for name, motor in ot.MOTORS.items()} == {
        "simulation": 0.0088,
        "pololu_1000_hpcb": 0.0088,
    }


def test_the_rotor_s_inertia_is_that_of_a_small_solid_rotor():
    """Within two digits it is m r²/2 of 2 g and 3 mm, as its comment says."""
    for motor in ot.MOTORS.values():
        assert motor.rotor_inertia == pytest.approx(0.002 * 0.003**2 / 2, rel=0.01)


def test_every_figure_of_a_motor_has_a_unit_and_a_source():
    """Each field carries a Quantity with a source, as the robot's do."""
    assert all(quantity_of(ot.Motor, name).source for name in ot.Motor.model_fields)


def test_a_motor_is_given_by_name_by_table_or_as_a_value():
    """The three ways make one robot, and ``like`` fills what a table leaves out."""
    motor = ot.Motor(**OWN)
    assert _scenario(motor=OWN).robot.motor == motor
    assert ot.override(_scenario(), {"robot.motor": motor}).robot.motor == motor
    assert _scenario(motor="pololu_1000_hpcb").robot.motor is ot.MOTORS["pololu_1000_hpcb"]
    slower = _scenario(motor={"like": "pololu_1000_hpcb", "speed_bandwidth": 10.0}).robot.motor
    shipped = ot.MOTORS["pololu_1000_hpcb"]
    changed = {"name": "custom", "source": "", "speed_bandwidth": 10.0}
    assert slower == shipped.model_copy(update=changed)


def test_a_motor_survives_the_scenario_s_json_in_full():
    """A motor named in a file stands in the JSON with all of its figures, so that results do not
    change with the shipped motors."""
    scenario = _scenario(motor="pololu_1000_hpcb")
    text = scenario.model_dump_json()
    assert '"gear_ratio":986.41' in text
    again = ot.Scenario.model_validate_json(text)
    assert again == scenario
    assert again.model_dump_json() == text


def test_a_figure_of_a_motor_is_overridden_by_its_path():
    """``robot.motor.NAME`` reaches into the motor, and ``robot.motor`` takes a name."""
    scenario = ot.override(_scenario(), {"robot.motor.gear_ratio": 500})
    assert scenario.robot.motor.gear_ratio == 500
    assert ot.override(scenario, {"robot.motor": "simulation"}) == _scenario()


@pytest.mark.parametrize(
    ("robot", "where", "told"),
    [
        ({"motor": "pololu"}, "robot.motor", "simulation, pololu_1000_hpcb"),
        ({"roll_motor": "pololu"}, "robot.roll_motor", "simulation, pololu_1000_hpcb"),
        ({"motor": {"like": "pololu"}}, "robot.motor.like", "simulation, pololu_1000_hpcb"),
        ({"motor": {"gear_ratio": 100}}, "robot.motor.rotor_inertia", "required"),
        ({"motor": OWN | {"inertia": 1}}, "robot.motor.inertia", "rotor_inertia"),
        (
            {"motor": OWN | {"torque_limit": 0}},
            "robot.motor.torque_limit",
            "from 1e-07 to 1e+07 N m",
        ),
        (
            {"motor": {"like": "pololu_1000_hpcb", "winding": {"current_limit": 0.08}}},
            "robot.motor.winding.current_limit",
            "must be over no_load_current, 0.08 A",
        ),
        ({"motor": 3}, "robot.motor", "a table"),
    ],
)
def test_a_faulty_motor_is_named_by_its_place_with_the_choices(robot, where, told):
    """Unknown names list the shipped motors, unknown keys the motor's, and missing ones are
    named."""
    with pytest.raises(ScenarioError) as caught:
        _scenario(**robot)
    faults = {fault.where: str(fault) for fault in caught.value.faults}
    assert told in faults[where]


def test_a_motor_is_frozen():
    """A figure cannot be set in place."""
    with pytest.raises(TypeError, match="cannot be set"):
        ot.MOTORS["simulation"].gear_ratio = 1.0


def test_another_motor_brings_its_own_inertia_and_servo():
    """Belt and roll armature are J ratio² over the lever squared, of a belt that of both runs and
    the sprockets; the servo's gain is the belt's inertia over its time constant."""
    scenario = _scenario(motor=OWN | {"speed_bandwidth": 20.0})
    model, robot = scenario.to_spec().compile(), scenario.robot
    inertia = 4e-9 * 250.0**2
    for i in (1, 2, 3):
        roll = model.joint(f"roll_{i}")
        runs = [model.joint(f"belt_{name}_{i}").dofadr[0] for name in ("upper", "lower")]
        ends = [model.joint(f"sprocket_{name}_{i}").dofadr[0] for name in ("front", "rear")]
        turning = model.dof_armature[ends].sum() / robot.lug_radius**2
        belt = model.dof_armature[runs].sum() + turning
        assert belt == pytest.approx(inertia / robot.lug_radius**2)
        assert turning < 0.05 * belt
        assert model.dof_armature[roll.dofadr[0]] == pytest.approx(inertia)
        gain = model.actuator(f"belt_{i}").gainprm[0]
        assert gain == pytest.approx(inertia / robot.lug_radius**2 / 0.05)


def test_the_rotary_motor_may_be_another():
    """With ``roll_motor`` the modules roll with its inertia, and the belts keep the crawler's."""
    model = _scenario(roll_motor=OWN).to_spec().compile()
    reference = _scenario().to_spec().compile()
    for i in (1, 2, 3):
        roll, belt = (model.joint(f"{name}_{i}").dofadr[0] for name in ("roll", "belt_upper"))
        assert model.dof_armature[roll] == pytest.approx(4e-9 * 250.0**2)
        assert model.dof_armature[belt] == reference.dof_armature[belt]


def test_a_heavier_rotor_starts_more_slowly():
    """With a hundred times the inertia and the same torque the robot falls behind in the first
    tenth of a second: the inertia counts in the run, not only in the model."""
    heavy = {"like": "simulation", "rotor_inertia": 100 * ot.MOTORS["simulation"].rotor_inertia}
    brief = {"run": {"time_limit": 0.1}, "pipes": PIPES}
    results = ot.run_batch(
        [validate(brief | {"robot": {"motor": motor}}) for motor in ("simulation", heavy)],
        no_load=False,
    )
    usual, slow = (r.trajectory["belt_speed"][-1].mean() for r in results)
    assert slow < 0.5 * usual


def test_the_torque_limit_of_a_motor_by_name_can_be_set():
    """``robot.motor.torque_limit`` is set in the motor's table, whether the file names the motor
    or writes it out."""
    for motor in (OWN, "simulation"):
        changed = ot.override(_scenario(motor=motor), {"robot.motor.torque_limit": 0.2})
        assert changed.robot.motor.torque_limit == 0.2


def test_feasible_speed_is_on_the_torque_speed_line():
    """At the speed that the robot holds against a third of its weight the line gives just that
    torque."""
    robot = _scenario(motor=OWN).robot
    speed = robot.feasible_belt_speed / robot.lug_radius
    torque = 0.6 * (1 - speed / 12.0)
    assert torque == pytest.approx(robot.mass * 9.81 / 3 * robot.lug_radius)


LINE = ot.MOTORS["pololu_1000_hpcb"]


def test_the_published_motor_s_figures_belong_together():
    """Both ends of its line are at 12 V and at the maker's currents, 80 mA and 0.75 A, and back to
    the torques that these stand for."""
    coil = LINE.winding
    ends = np.array([0.0, LINE.stall_torque]), np.array([LINE.no_load_speed, 0.0])
    current = LINE.current(*ends)
    assert current == pytest.approx([0.08, 0.75], rel=0.01)
    back_emf = coil.torque_constant * LINE.gear_ratio * ends[1]
    assert coil.resistance * current + back_emf == pytest.approx([12.0, 12.0], rel=0.01)
    assert [LINE.torque_at(a) for a in current] == pytest.approx(ends[0])
    assert LINE.torque_at(0.04) == 0.0


def test_the_maker_s_stall_torques_ask_for_gears_of_like_losses():
    """75:1 and 100:1 of the same motor, of 1.0 and 1.3 kg cm, have efficiencies near that of 1000:1
    by the same currents; more gears lose more."""
    coil = LINE.winding
    parts = [
        torque * 0.0980665 / (ratio * coil.torque_constant * (0.75 - coil.no_load_current))
        for ratio, torque in ((75.81, 1.0), (100.37, 1.3))
    ]
    assert parts == pytest.approx([LINE.efficiency + 0.05] * 2, abs=0.03)


def test_a_current_has_no_jump_where_a_motor_begins_to_brake():
    """From driving to braking the current falls steadily through that of friction alone, to nothing
    where friction holds the load, and grows again beyond, up to that of the limit."""
    torque = np.linspace(-1.0, 1.0, 2001)
    current = LINE.current(torque, np.full(2001, 2.0))
    assert np.abs(np.diff(current)).max() < 1e-3
    assert LINE.current(np.array([0.0]), np.array([2.0])) == pytest.approx([0.08])
    held = LINE.friction_torque / LINE.efficiency
    assert LINE.backdriving_torque == pytest.approx(held)
    assert LINE.current(np.array([-held]), np.array([2.0])) == pytest.approx([0.0])
    assert np.array_equal(current, LINE.current(-torque, np.full(2001, -2.0)))
    weak, sign = LINE.model_copy(update={"torque_limit": 0.3}), np.array([1.0, -1.0])
    assert weak.current(3.0 * sign, np.full(2, 0.1)) == pytest.approx([LINE.current(0.3, 0.0)] * 2)


def test_electric_power_is_mechanical_power_and_losses():
    """What goes in is what comes out at the shaft, what the winding heats, and what friction and
    gears take, also while the motor brakes."""
    speed, coil = 2.0, LINE.winding
    for torque in (0.5, -0.2, -0.8):
        one = np.array([torque]), np.array([speed])
        current, passed = LINE.current(*one)[0], torque * speed
        gears = passed / LINE.efficiency if torque > 0 else passed * LINE.efficiency
        losses = coil.resistance * current**2 + LINE.friction_torque * speed
        assert LINE.electric_power(*one)[0] == pytest.approx(gears + losses)


def test_a_winding_warms_by_the_maker_s_exponentials():
    """With little heat, in steps of any length: winding and housing each by P R (1 - exp(-t/tau));
    in the end hotter by what copper resists more as it is hot."""
    coil = LINE.winding
    time = np.sort(np.random.default_rng(1).uniform(0, 400, 300))
    rise = coil.temperature(time, np.full((300, 1), 1e-3))[:, 0] - 20.0
    stages = (
        (coil.thermal_resistance, coil.thermal_time),
        (coil.housing_resistance, coil.housing_time),
    )
    past = time - time[0]
    heat = coil.resistance * 1e-6
    expected = sum(heat * resistance * (1 - np.exp(-past / tau)) for resistance, tau in stages)
    assert rise == pytest.approx(expected, rel=1e-4)
    cold = coil.resistance * 0.2**2 * (coil.thermal_resistance + coil.housing_resistance)
    end = coil.temperature(np.linspace(0, 1e4, 20001), np.full((20001, 1), 0.2))[-1, 0] - 20.0
    assert end == pytest.approx(cold / (1 - 0.00393 * cold), rel=1e-6)


def test_a_stalled_motor_is_burnt_in_seconds():
    """The maker warns of damage within seconds: at its stall current the winding is at 125 °C,
    where those of small motors end, in 5 to 15 s; at a quarter of it, as the maker advises,
    never."""
    time = np.linspace(0.0, 3600.0, 36001)
    stalled = LINE.winding.temperature(time, np.full((36001, 1), 0.75))[:, 0]
    assert 5.0 < time[np.argmax(stalled > 125)] < 15.0
    advised = LINE.winding.temperature(time, np.full((36001, 1), 0.75 / 4))
    assert advised.max() < 60.0


def test_what_a_driver_lets_through_limits_the_torque():
    """``winding.current_limit`` lowers the torque that the motor drives with, never raises it, and
    a run's belts stay below that; a table gives the one key, and the rest is the shipped motor's.
    """
    limited = _scenario(motor={"like": LINE.name, "winding": {"current_limit": 0.2}}).robot.motor
    assert limited.winding == LINE.winding.model_copy(update={"current_limit": 0.2})
    assert limited.max_torque == pytest.approx(LINE.torque_at(0.2))
    assert limited.max_torque < limited.torque_limit
    strong = LINE.winding.model_copy(update={"current_limit": 3.0})
    assert LINE.model_copy(update={"winding": strong}).max_torque == LINE.torque_limit
    start = {"world.gravity": [0.0, 0.0, 0.0], "run.time_limit": 0.3}
    result = ot.run(ot.override(_scenario(motor=limited), start), no_load=False)
    driven = result.trajectory["motor_torque"].max()
    assert driven == pytest.approx(limited.max_torque, rel=0.01)
    assert max(result.metrics["motor_current_max_a"]) <= 0.2 * 1.01


def test_a_motor_without_a_winding_tells_no_current():
    """The question is refused with the motor's name."""
    motor, one = ot.MOTORS["simulation"], np.ones(1)
    for ask in (
        lambda: motor.torque_at(0.2),
        lambda: motor.current(one, one),
        lambda: motor.electric_power(one, one),
    ):
        with pytest.raises(ValueError, match="'simulation' has no winding"):
            ask()


def test_windings_of_similar_motors_have_equal_currents_and_temperatures():
    """In a robot of twice the size, with torques and speeds of the law of similarity."""
    stated = LINE.model_copy(update={"scale": 1.0})
    large = stated.at_scale(2.0)
    torque, speed = np.array([0.3, -0.5]), np.array([2.0, 1.0])
    similar = torque * 2.0**4, speed / 2.0**0.5
    assert large.current(*similar) == pytest.approx(stated.current(torque, speed))
    power = stated.electric_power(torque, speed)
    assert large.electric_power(*similar) == pytest.approx(power * 2.0**3.5)
    time, current = np.linspace(0.0, 30.0, 301), np.full((301, 1), 0.5)
    hot = stated.winding.temperature(time, current)
    assert large.winding.temperature(time * 2.0**0.5, current) == pytest.approx(hot)


def test_the_efficiency_that_reach_assumes_is_near_that_of_the_published_motor():
    """Work of the rotor over electric energy in a climb, as docs/how-to/towns.md says it."""
    robot = ot.Omnitrack(motor=LINE)
    torque, speed = robot.climbing_torque, robot.feasible_belt_speed / robot.lug_radius
    taken = LINE.electric_power(np.array([torque]), np.array([speed]))[0]
    part = torque * speed / LINE.efficiency / taken
    assert part == pytest.approx(0.32, abs=0.005)
    assert ot.Supply().efficiency == pytest.approx(part, rel=0.1)
