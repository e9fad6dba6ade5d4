"""The exact collider: its surfaces, its contacts, and the same runs as with walls of primitives."""

import importlib
import json
import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from ctypes import CFUNCTYPE
from hashlib import sha256
from threading import Barrier

import mujoco
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, frame_along, quaternion_from_matrix, unit
from omnitrack_sim.pipes import (
    Assembly,
    Elbow,
    Part,
    Reducer,
    Step,
    Straight,
    Tee,
    native,
    route,
)
from omnitrack_sim.pipes.fittings import reducer
from omnitrack_sim.pipes.native import (
    NUMBER,
    NUMBERS,
    SIGNATURES,
    WORD,
    _digest,
    announce,
    c_function,
    load_file,
    pointers,
)
from omnitrack_sim.robots.omnitrack import track
from omnitrack_sim.robots.omnitrack.track import (
    collide_line,
    install_lines,
    line_record,
    sprocket_record,
)
from omnitrack_sim.walls.collider import PREVIOUS, collide, enter
from omnitrack_sim.walls.geoms import add_exact_walls
from omnitrack_sim.walls.record import (
    ENDS,
    KIND,
    KIND_SIZE,
    RECORD_SIZE,
    SIZES,
    bounding_box,
    kinds,
)
from omnitrack_sim.walls.record import wall_record as record_of

FITTINGS = {
    "straight": Straight(0.4),
    "reducer": Reducer(0.15, 0.15),
    "reducer_widening": Reducer(0.15, 0.18, 0.14),
    "reducer_steep": Reducer(0.12, 0.16, 0.08),
    "elbow_240": Elbow(0.24),
    "elbow_90": Elbow(0.09),
    "elbow_30_degrees": Elbow(0.2, math.radians(30)),
    "u_bend": Elbow(0.12, math.pi),
    "tee": Tee(),
    "tee_sharper": Tee(fillet_radius=0.002),
}
RADIUS, HALF, PITCH = 0.0266, 0.042, 0.006
LINE_CONTACTS = CFUNCTYPE(
    WORD,
    NUMBERS,
    WORD,
    WORD,
    *[NUMBERS] * 2,
    WORD,
    WORD,
    *[NUMBERS] * 2,
    WORD,
    WORD,
    *[NUMBER] * 3,
)
DEPTH = 0.03
install_lines()


def wall_record(fitting, ends):
    """Record of a wall that is solid to DEPTH."""
    return record_of(fitting, ends, DEPTH)


def line_contacts(records, position, matrix, margin=0.0, half=HALF):
    """Contacts (k, 10) of geom 1, a line, with geom 0; the first two ``records`` are theirs."""
    con, sizes = (
        np.zeros((track.MAX_CONTACTS, track.CONTACT_SIZE)),
        np.ravel(records)[SIZES:].copy(),
    )
    kind = int(np.ravel(records)[KIND])
    room, records, *frames = pointers(con, records, position, matrix)
    (row,) = np.flatnonzero(kinds.table[1::KIND_SIZE] == kind)
    addresses = map(int, kinds.table[KIND_SIZE * row + 2 : KIND_SIZE * row + 4])
    call = c_function(track.line_contacts, LINE_CONTACTS).ctypes
    geoms = *pointers(sizes), records, 0, RECORD_SIZE, *frames, 1, 0
    return con[: call(room, *addresses, *geoms, RADIUS, half, margin)]


def contacts(fitting, centre, direction, margin=0.0, ends=(True, True, True), side=0.0):
    """Distances (k,), positions and normals (k, 3) of a track's contacts, and places (k,) along its
    line, m. Its module's x axis is as far towards +x as it can be."""
    box, _ = bounding_box(fitting, 0.0)
    z = direction / np.linalg.norm(direction)
    x = np.array([1.0, 1e-3, 0.0]) - z * (z @ [1.0, 1e-3, 0.0])
    x /= np.linalg.norm(x)
    matrix = np.stack([np.eye(3), np.stack([x, np.cross(z, x), z], axis=-1)])
    records = wall_record(fitting, ends[: len(fitting.ports)]), line_record(PITCH, 1.0, side)
    position = np.stack([box, centre]).ravel()
    found = line_contacts(np.array(records), position, matrix.ravel(), margin)
    lug = found[:, 1:4] + found[:, 4:7] * (RADIUS + found[:, :1] / 2)
    return found[:, 0], found[:, 1:4], found[:, 4:7], (lug - centre) @ z


def sprocket_contacts(fitting, place, other):
    """Contacts (k, 10) of a sprocket with a fitting; that of the module's other end is at
    ``other``."""
    box, _ = bounding_box(fitting, 0.0)
    records = np.array(
        [wall_record(fitting, (True, True)), sprocket_record(1), np.zeros(RECORD_SIZE)]
    )
    position = np.stack([box, place, other]).ravel()
    return line_contacts(records, position, np.tile(np.eye(3).ravel(), 3), half=1e-9)


def touching_lines(fitting, count, seed=0):
    """Centres and directions of lines that press a little into the wall somewhere between the
    ports."""
    rng = np.random.default_rng(seed)
    box, half = bounding_box(fitting, 0.0)
    directions = unit(rng.normal(size=(count, 3)))
    places = np.linspace(-HALF, HALF, 4001)
    for direction in directions:
        for _ in range(200):
            centre = box + rng.uniform(-1, 1, 3) * half
            points = centre + places[:, None] * direction
            # A few of them tell within 0.3 mm how near the line comes.
            near = fitting.signed_distance(points[::20])[0].min()
            if not 0.85 * RADIUS - 0.3e-3 < near < RADIUS + 0.3e-3:
                continue
            d, _ = fitting.signed_distance(points)
            if fitting.extent(points).min() > 0.001 and 0.85 * RADIUS < d.min() < RADIUS:
                yield centre, direction, places, d
                break


@pytest.mark.parametrize("name", FITTINGS)
def test_mujoco_has_the_contacts_of_the_line(name):
    """MuJoCo's contacts are, bit for bit, those of the line in the frames of its geoms: what the
    collider reads from MuJoCo's structures and writes to its contacts is in its place."""
    fitting = FITTINGS[name]
    box, half = bounding_box(fitting, 0.0)
    spec = mujoco.MjSpec()
    add_exact_walls(spec, Assembly((Part("pipe", fitting, Pose()),)))
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[RADIUS, HALF, 0], userdata=line_record(PITCH, 1.0)
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(4)
    inside = box + rng.uniform(-1, 1, (250, 3)) * half
    distance, gradient = fitting.signed_distance(inside)
    near = inside - (distance - rng.uniform(0.015, 0.03, 250))[:, None] * gradient
    seen = 0
    for centre, direction in zip(near[distance > 0], rng.normal(size=(250, 3)), strict=False):
        data.qpos[:3] = centre
        data.qpos[3:] = quaternion_from_matrix(frame_along(direction, 0.0))
        mujoco.mj_forward(model, data)
        found = line_contacts(model.geom_user, data.geom_xpos, data.geom_xmat)
        assert data.ncon == len(found)
        np.testing.assert_array_equal(data.contact.dist, found[:, 0])
        np.testing.assert_array_equal(data.contact.pos, found[:, 1:4])
        seen += len(found)
    assert seen > 100


@pytest.mark.parametrize("name", FITTINGS)
def test_contacts_lie_on_the_wall_and_none_is_missed(name):
    """Each contact is exact; the deepest point of the line and its pressed ends are among them."""
    fitting = FITTINGS[name]
    seen = 0
    for centre, direction, places, d in touching_lines(fitting, 60):
        distance, position, normal, s = contacts(fitting, centre, direction)
        assert len(distance) > 0
        lug = centre + s[:, None] * direction
        exact, gradient = fitting.signed_distance(lug)
        np.testing.assert_allclose(distance, exact - RADIUS, atol=1e-9)
        np.testing.assert_allclose(normal, gradient, atol=1e-6)
        wall = position - normal * distance[:, None] / 2
        np.testing.assert_allclose(fitting.signed_distance(wall)[0], 0.0, atol=1e-8)
        # A minimum next to the line's end counts as that end.
        next_to_end = 0 < HALF - abs(places[np.argmin(d)]) < track.MIN_END_DISTANCE
        assert distance.min() <= d.min() - RADIUS + (
            track.MIN_END_DISTANCE**2 / RADIUS if next_to_end else 1e-6
        )
        for end in (0, -1):
            if d[end] < RADIUS:
                assert np.abs(s - places[end]).min() < 1e-9
        seen += 1
    assert seen > 20


def test_a_line_along_a_straight_rests_on_its_two_ends():
    """Two contacts, as deep as the line is off the axis; one end alone where the line is tilted
    away."""
    pipe = Straight(0.4)
    offset = pipe.radius - RADIUS + 1e-4
    distance, _, _, s = contacts(pipe, np.array([offset, 0, 0.2]), np.array([0, 0, 1.0]))
    np.testing.assert_allclose(distance, -1e-4, atol=1e-12)
    np.testing.assert_allclose(np.sort(s), [-HALF, HALF])
    _, _, _, s = contacts(pipe, np.array([offset, 0, 0.2]), np.array([0.01, 0, 1.0]))
    np.testing.assert_allclose(s, [HALF])


def test_where_a_straight_wall_stops_carrying_there_is_a_contact():
    """At an open end, at a port before an elbow, at a tee's rim; not where another straight goes
    on."""
    pipe = Straight(0.4)
    across = np.array([pipe.radius - RADIUS + 1e-4, 0, 0.38])
    for ends, count in (((True, True), 2), ((True, False), 1)):
        _, position, _, _ = contacts(pipe, across, np.array([0, 0, 1.0]), ends=ends)
        assert len(position) == count
    assert position[0, 2] == pytest.approx(0.38 - HALF)
    tee = Tee()
    place = np.array([tee.radius - RADIUS + 1e-4, 0, -(tee.radius + tee.fillet_radius) - 0.01])
    _, position, _, s = contacts(tee, place, np.array([0, 0, 1.0]))
    rim = -(tee.radius + tee.fillet_radius)
    assert np.abs(position[:, 2] - rim).min() < 0.004
    assert s.min() == pytest.approx(-HALF)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_run_touches_the_wall_that_it_faces(side):
    """Each wall belongs to one run of the chain, that beside both to both."""
    pipe = Straight(0.4)
    offset = pipe.radius - RADIUS + 1e-4
    for angle in np.radians([0, 60, 86, 89, 91, 94, 120, 180]):
        centre = np.array([offset * np.cos(angle), offset * np.sin(angle), 0.2])
        found, *_ = contacts(pipe, centre, np.array([0, 0, 1.0]), side=side)
        assert len(found) == (2 if side * np.cos(angle) >= -track.BAND else 0)


def test_lugs_half_a_pitch_away_push_against_the_flanks_of_a_bend():
    """A line along the inner side of an elbow touches at its nearest point and half a pitch to
    either side, each as deep as the wall is there."""
    elbow = Elbow(0.24)
    middle = math.radians(45)
    towards = np.array([math.cos(middle), 0.0, -math.sin(middle)])
    centre = np.array([elbow.mean_radius, 0, 0]) - towards * (
        elbow.mean_radius - elbow.radius + RADIUS - 3e-4
    )
    along = np.array([math.sin(middle), 0.0, math.cos(middle)])
    distance, _, _, s = contacts(elbow, centre, along)
    nearest = s[np.argmin(distance)]
    np.testing.assert_allclose(np.sort(s - nearest), [-PITCH / 2, 0.0, PITCH / 2], atol=1e-6)
    assert distance.min() == pytest.approx(-3e-4, abs=1e-7)


@pytest.mark.parametrize("lean_deg", [20.0, 35.0, 39.0, 60.0])
def test_an_end_that_a_wall_faces_is_its_sprockets(lean_deg):
    """The end of a run touches up to an angle, from there on the sprocket in its place alone: one
    of both, as deep, at the same point."""
    pipe, lean = Straight(0.4), math.radians(lean_deg)
    # A track whose front leans against the wall.
    along = np.array([math.sin(lean), 0.0, math.cos(lean)])
    end = np.array([pipe.radius - RADIUS + 1e-4, 0.0, 0.2])
    run = contacts(pipe, end - HALF * along, along, side=1.0)
    front = sprocket_contacts(pipe, end, end - 2 * HALF * along)
    rear = sprocket_contacts(pipe, end - 2 * HALF * along, end)
    on_sprocket = math.sin(lean) > track.LEAN
    assert (len(run[0]), len(front), len(rear)) == ((0, 1, 0) if on_sprocket else (1, 0, 0))
    found = front[0, :4] if on_sprocket else [run[0][0], *run[1][0]]
    np.testing.assert_allclose(found, [-1e-4, pipe.radius + 5e-5, 0.0, 0.2], atol=1e-9)


@pytest.mark.parametrize("name", ["straight", "elbow_240", "tee"])
def test_a_fast_ball_stays_in_its_pipe(name):
    """A lug thrown at the wall at 6 m/s comes back; the wall's box leaves it that much room."""
    fitting = FITTINGS[name]
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, 0]
    add_exact_walls(spec, Assembly((Part("pipe", fitting, Pose()),)))
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[RADIUS, 1e-9, 0],
        solref=[0.01, 1],
        priority=1,
        contype=1,
        conaffinity=2,
        userdata=line_record(PITCH, 1.0),
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    low, high = fitting.bounds
    rng = np.random.default_rng(1)
    starts = rng.uniform(low, high, (400, 3))
    inside = (fitting.signed_distance(starts)[0] > RADIUS) & (fitting.extent(starts) > 0.03)
    for start, direction in zip(starts[inside][:60], unit(rng.normal(size=(60, 3))), strict=False):
        mujoco.mj_resetData(model, data)
        data.qpos[:3], data.qvel[:3] = start, 6.0 * direction
        for _ in range(60):
            mujoco.mj_step(model, data)
            if fitting.extent(data.qpos[None, :3])[0] < 0:
                break  # out of a port
            assert fitting.signed_distance(data.qpos[None, :3])[0][0] > -RADIUS / 2


def test_a_pair_of_geoms_without_a_function_of_mujoco_is_not_entered():
    """Not known how MuJoCo would go on: the types are named, height field first."""
    types = mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_PLANE
    told = rf"no function for geoms of types \({types[0].value}, {types[1].value}\)"
    with pytest.raises(RuntimeError, match=told):
        enter(collide, types[1], PREVIOUS)


def test_a_line_beyond_the_wall_belongs_to_another_pipe():
    """Nothing touches from outside, and nothing beyond the ports."""
    pipe = Straight(0.4)
    assert len(contacts(pipe, np.array([0.2, 0, 0.2]), np.array([0, 0, 1.0]))[0]) == 0
    assert len(contacts(pipe, np.array([0.054, 0, 0.6]), np.array([0, 0, 1.0]))[0]) == 0


def test_the_bounding_box_holds_the_bore():
    """Every point of the bore between the ports lies in the box, and the box is no larger than it
    needs."""
    rng = np.random.default_rng(2)
    for fitting in FITTINGS.values():
        box, half = bounding_box(fitting, 0.0)
        points = box + rng.uniform(-1.5, 1.5, (20000, 3)) * half
        inside = (fitting.signed_distance(points)[0] > 0) & (fitting.extent(points) > 0)
        if isinstance(fitting, Elbow):  # an elbow's extent goes on round behind its end planes
            inside &= np.linalg.norm(points - box, axis=-1) < 2 * np.linalg.norm(half)
        reached = np.abs(points[inside] - box)
        assert (reached <= half + 1e-9).all()
        assert (reached.max(axis=0) > 0.9 * half).all()


def test_other_height_fields_collide_as_before():
    """A capsule on a height field without a record: the same state, to the bit, with the collider
    installed and in a process that has never heard of it."""
    text = """<mujoco><asset>
    <hfield name="h" nrow="3" ncol="3" size="1 1 .2 .1" elevation="0 0 0 0 1 0 0 0 0"/></asset>
    <worldbody><geom type="hfield" hfield="h"/>
    <body pos=".1 .2 .5"><freejoint/><geom type="capsule" size=".1 .2"/>
    </body></worldbody></mujoco>"""
    program = f"""
import mujoco
model = mujoco.MjModel.from_xml_string({text!r})
data = mujoco.MjData(model)
mujoco.mj_step(model, data, 500)
print(data.ncon, data.qpos.tobytes().hex())
"""
    run = [sys.executable, "-c", program]
    told = subprocess.run(run, capture_output=True, text=True, check=True).stdout.split()
    model = mujoco.MjModel.from_xml_string(text)
    install_lines()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert data.ncon > 0
    assert told == [str(data.ncon), data.qpos.tobytes().hex()]


def joined_contacts(way, centre, direction):
    """Distances (k,) and normals (k, 3) of a track's contacts with all fittings of a route along
    +z."""
    spec = mujoco.MjSpec()
    add_exact_walls(spec, way.network)
    records = spec.compile().geom_user
    found = []
    for part, record in zip(way.network.parts, records, strict=True):
        local = part.pose.inverse()
        ends = record[ENDS : ENDS + 3] > 0
        distance, _, normal, _ = contacts(
            part.fitting, local.apply(centre), local.rotation @ direction, 0.001, tuple(ends)
        )
        found += [(d, *(part.pose.rotation @ n)) for d, n in zip(distance, normal, strict=True)]
    found = np.array(found).reshape(-1, 4)
    return found[:, 0], found[:, 1:]


@pytest.mark.parametrize("bore", [0.15, 0.13])
def test_a_track_over_the_kinks_of_a_reducer(bore):
    """The deepest contact over all fittings is as deep as the line lies in the exact wall, at both
    ends of a cone."""
    cone = Reducer(0.05, bore)
    steps = [
        ("a", Straight(0.2), "start", "end"),
        ("b", cone, "start", "end"),
        ("c", Straight(0.2, bore), "start", "end"),
    ]
    way = route([Step(*step) for step in steps])
    rng = np.random.default_rng(4)
    z = np.concatenate([np.linspace(0, 0.2, 2), np.linspace(0.25, 0.45, 2)])
    radius = np.array([0.08, 0.08, bore / 2, bore / 2])
    seen = 0
    for joint in (0.2, 0.25):
        for _ in range(30):
            tilt, u = rng.uniform(-0.4, 0.4), rng.uniform(0, 2 * np.pi)
            out = np.array([np.cos(u), np.sin(u), 0])
            direction = np.sin(tilt) * out + [0, 0, np.cos(tilt)]
            middle = np.array([0, 0, joint + rng.uniform(-HALF, HALF)])
            s = np.linspace(-HALF, HALF, 2001)

            def depths(offset, middle=middle, out=out, direction=direction, s=s):
                """Distance (2001,) of points of the line to the wall: three lines in the plane
                through the axis."""
                points = middle + offset * out + s[:, None] * direction
                p = np.stack([points @ out, points[:, 2]], axis=-1)
                found = []
                for k in range(3):
                    a, b = np.array([radius[k], z[k]]), np.array([radius[k + 1], z[k + 1]])
                    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
                    found.append(np.linalg.norm(p - a - t[:, None] * (b - a), axis=-1))
                return np.min(found, axis=0)

            low, high = 0.03, 0.06  # bring the line to where it presses 0.1 mm deep
            for _ in range(30):  # to the last digit that is compared
                offset = (low + high) / 2
                low, high = (
                    (low, offset) if depths(offset).min() < RADIUS - 1e-4 else (offset, high)
                )
            d = depths(offset)
            from_end = HALF - abs(s[np.argmin(d)])
            # A minimum next to the line's end counts as that end.
            if abs(d.min() - RADIUS + 1e-4) > 1e-6 or 0 < from_end < track.MIN_END_DISTANCE:
                continue
            distance, _ = joined_contacts(way, middle + offset * out, direction)
            assert distance.min() == pytest.approx(-1e-4, abs=5e-6)
            seen += 1
    assert seen > 40


def test_a_small_step_carries_a_track_on_both_sides():
    """Where bores differ by manufacturing tolerance, a line ends at the joint on either side;
    elsewhere it does not."""
    for bore, ends in ((0.16, False), (0.1605, True)):
        steps = [
            ("a", Straight(0.2), "start", "end"),
            ("b", Tee(inner_diameter=bore), "run_start", "run_end"),
        ]
        spec = mujoco.MjSpec()
        add_exact_walls(spec, route([Step(*step) for step in steps]).network)
        records = spec.compile().geom_user
        found = records[:, ENDS : ENDS + 3] > 0
        assert found.tolist() == [[True, ends, False], [ends, True, True]]


@pytest.mark.parametrize(
    ("name", "start"),
    [("vertical_climb", 0.5), ("reducer", 0.1), ("elbow_short", 0.2), ("tee_turn", 0.2)],
)
def test_runs_agree_with_primitives(name, start):
    """The shipped runs, from nearer, end alike, in the same time within 5 %, with normal forces
    within 15 %."""
    scenario = ot.load_scenario(name, {"start.distance": start})
    pieces = ot.override(scenario, {"physics.collider": "primitives"})
    exact, other = ot.run_batch([scenario, pieces], no_load=False)
    assert exact.outcome is other.outcome
    assert exact.duration_s == pytest.approx(other.duration_s, rel=0.05)
    np.testing.assert_allclose(
        exact.metrics["normal_force_mean_n"], other.metrics["normal_force_mean_n"], rtol=0.15
    )
    assert (exact.provenance["collider"], other.provenance["collider"]) == ("exact", "primitives")


def test_runs_repeat_at_any_thread_count():
    """Two threads and one give the same bytes."""
    base = ot.override(ot.load_scenario("tee_turn"), {"run.time_limit": 1.0})
    trials = [ot.override(base, {"start.theta5_deg": angle}) for angle in (0.0, 20.0, 50.0)]
    for one, two in zip(
        ot.run_batch(trials, threads=1), ot.run_batch(trials, threads=2), strict=True
    ):
        np.testing.assert_array_equal(one.trajectory.qpos, two.trajectory.qpos)


def test_walls_stay_exact_under_a_turned_route():
    """Contacts of a robot in a route that leans: every contact position lies within its depth of
    the exact surface."""
    changes = {"start.axis": [0.3, -0.5, 0.8], "start.turn_deg": 33.0}
    scenario = ot.override(ot.load_scenario("elbow_short"), changes)
    network = scenario.route.network
    model = scenario.to_spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = ot.Simulation([scenario]).data(0).qpos
    data.ctrl[:] = 0
    mujoco.mj_step(model, data, 100)
    assert data.ncon >= 6
    distance, _ = network.signed_distance(data.contact.pos)
    np.testing.assert_allclose(distance, data.contact.dist / 2, atol=1e-9)


def test_records_have_their_size():
    """What the compiled code reads is what is written."""
    for fitting in FITTINGS.values():
        assert wall_record(fitting, (True,) * len(fitting.ports)).shape == (RECORD_SIZE,)


@pytest.mark.long
def test_a_later_process_loads_the_collider_from_disk():
    """Once compiled, every function is loaded: a fresh process that runs a robot has no numba."""
    program = """
import sys
import omnitrack_sim as ot
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings
ot.Simulation([ot.load_scenario("straight")]).step()
for fitting in shipped_fittings().values():
    for name in ("surface", "span", "clear"):
        fitting.wall_address(name)
print("numba" in sys.modules)
"""
    # Types of pointers that a process has made before are those of compiled functions, too.
    for before in ("", "import ctypes\nctypes.POINTER(ctypes.c_double)\n"):
        run = [sys.executable, "-c", before + program]
        told = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    assert told.strip() == "False"


def _third(x):
    return x / 3.0


def test_code_that_is_damaged_or_lacks_something_is_compiled_again(tmp_path, monkeypatch):
    """It is not loaded, which would end the process, and its file is made anew."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    call = c_function.__wrapped__
    signature = CFUNCTYPE(NUMBER, NUMBER)
    assert call(_third, signature).ctypes(1.0) == 1 / 3
    (file,) = tmp_path.glob("*.o")
    whole = file.read_bytes()
    address = load_file(file)
    assert address
    assert signature(address)(1.0) == 1 / 3
    head, _, code = whole[32:].partition(b"\n")
    body = json.dumps([json.loads(head)[0], ["of_nobody"]]).encode() + b"\n" + code
    for octets in (b"", whole[:-9], whole[:99] + b"x" + whole[100:], sha256(body).digest() + body):
        file.write_bytes(octets)
        assert load_file(file) is None
        assert call(_third, signature).ctypes(1.0) == 1 / 3
        assert load_file(file)


@pytest.mark.parametrize("may_write", [True, False])
def test_who_needs_code_that_another_compiles_waits_and_loads_it(tmp_path, monkeypatch, may_write):
    """It is compiled once, and nothing but the code is left; where nothing may be written, each
    compiles its own."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path if may_write else "/dev/null/cache"))
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null")
    made, compiled, together = native._made, [], Barrier(3)

    def counted(*arguments):
        compiled.append(arguments)
        return made(*arguments)

    def call(_):
        together.wait()
        return c_function.__wrapped__(_third, CFUNCTYPE(NUMBER, NUMBER)).ctypes(1.0)

    monkeypatch.setattr(native, "_made", counted)
    with ThreadPoolExecutor(3) as threads:
        assert [*threads.map(call, range(3))] == 3 * [1 / 3]
    assert len(compiled) == (1 if may_write else 3)
    assert [path.suffix for path in tmp_path.iterdir()] == [".o"] * may_write


def test_code_on_disk_is_known_by_all_that_it_depends_on(monkeypatch):
    """Another value of a constant, of the function itself or of one that it calls, is other
    code."""
    functions = collide_line, Reducer.wall.span, Straight.wall.span
    signature = CFUNCTYPE(NUMBER, NUMBER)
    before = [_digest(function, signature) for function in functions]
    monkeypatch.setattr(track, "SPACING", 0.004)
    monkeypatch.setattr(reducer, "POSITION", 1e-6)
    after = [_digest(function, signature) for function in functions]
    assert [a == b for a, b in zip(before, after, strict=True)] == [False, False, True]


def test_a_long_compilation_is_announced(tmp_path, monkeypatch, capsys):
    """A line on standard error where code is compiled, none where it comes from disk."""
    (tmp_path / "twice_module.py").write_text("def twice(x):\n    return 2.0 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    twice = importlib.import_module("twice_module").twice
    for compiles in (True, False):
        announce.cache_clear()
        assert (
            c_function.__wrapped__(twice, CFUNCTYPE(NUMBER, NUMBER), is_long=True).ctypes(3.0)
            == 6.0
        )
        assert ("compiling exact walls" in capsys.readouterr().err) == compiles


@pytest.mark.parametrize("fitting", [Reducer(0.15, 0.1), Reducer(0.15, 0.2, 0.12)])
def test_a_line_across_the_wide_end_is_held_where_the_cone_is_nearest(fitting):
    """The span of a line is the part whose feet lie on the cone before its wide end, also where it
    passes those normals twice."""
    span, rng, twice = (
        c_function(fitting.wall.span, SIGNATURES["span"]).ctypes,
        np.random.default_rng(4),
        0,
    )
    sizes, out = np.array(fitting.sizes), np.zeros(16)
    narrows = fitting.slope < 0
    for _ in range(400):
        angle, wide = rng.uniform(0, 2 * math.pi), 0.0 if narrows else fitting.length
        # Lines across the pipe near the wide end, between their ends 0.1 m to both sides.
        point = np.array([*rng.uniform(-0.03, 0.03, 2), wide + rng.uniform(-0.02, 0.02)])
        along = unit(np.array([math.cos(angle), math.sin(angle), rng.uniform(-0.3, 0.3)]))
        out[:4] = -0.1, 0.1, 0.0, 0.0
        span(*pointers(sizes, np.zeros(4)), *point, *along, *pointers(out))
        s = np.linspace(-0.1, 0.1, 2001)
        points = point + s[:, None] * along
        # Distance to the cone without ends, and the height of the foot along the axis.
        from_axis = np.hypot(points[:, 0], points[:, 1])
        gap = fitting.radius + fitting.slope * points[:, 2] - from_axis
        foot = points[:, 2] - fitting.slope * gap / (1 + fitting.slope**2)
        held = (foot >= 0) & (points[:, 2] <= fitting.length)
        if not narrows:
            held = (foot <= fitting.length) & (points[:, 2] >= 0)
        inside = (s >= out[0]) & (s <= out[1])
        assert (held != inside).sum() <= 2
        twice += held.any() and not held[0] and not held[-1]
    assert twice > 20


def test_a_row_of_lugs_touches_neither_edge_nor_closed_end():
    """In pipes around any robot these are no walls that carry it."""
    spec = mujoco.MjSpec()
    spec.nuser_geom = RECORD_SIZE
    body = spec.worldbody.add_body(pos=[0.055, 0, 0.1])
    body.add_freejoint()
    kind, record = mujoco.mjtGeom.mjGEOM_CAPSULE, line_record(PITCH, 1.0)
    body.add_geom(type=kind, size=[RADIUS, 0.12, 0], userdata=record)
    install_lines()
    ot.add_pipes(spec, ot.Network(fittings=[{"kind": "cap", "name": "end", "length": 0.2}]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = {model.geom(number).name for number in data.contact.geom[:, 0]}
    assert {"rim_end_start", "plate_end_end"} <= {model.geom(i).name for i in range(model.ngeom)}
    assert names == {"wall_end"}
