"""Exact walls in MuJoCo Warp, on its CPU back end, against those of MuJoCo."""

import importlib
import math
import re
from ctypes import CFUNCTYPE

import mujoco
import numpy as np
import pytest

pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")

import contact_lots
import mujoco_warp as mjw
import warp as wp
import warp_contacts
from documents import page

import omnitrack_sim as ot
import omnitrack_sim.warp
from omnitrack_sim.base.errors import GeometryError, InputError
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Part
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import NUMBER, NUMBERS, SIGNATURES, c_function, pointers, row
from omnitrack_sim.walls.record import LONG, RECORD_SIZE, SIZES
from omnitrack_sim.warp.contacts import intrinsics
from omnitrack_sim.warp.translation import REAL, REALS, Translation, TranslationError

pytestmark = pytest.mark.device
wp.config.quiet = True
BLOCKS = re.findall(r"```python\n(.*?)```", page("gpu"), re.DOTALL)
NEAR, DEEP = 1e-5, 2e-6
"""Depth, m, up to which a contact may be missing, and by which 999 of 1,000 depths differ at most;
all others by the first: MuJoCo's walls themselves are searched to 15 um."""
COUNT = 7
RULE = CFUNCTYPE(NUMBER, NUMBER, NUMBER, NUMBERS)
"""Of a function of two numbers and room for numbers."""


# What a translation has to know, as functions of two numbers and room for numbers.


@compiled
def loops(x, y, out):
    """Loops over ranges and tuples, with what ends and shortens them."""
    total = 0.0
    for i in range(2, COUNT):
        if i == 4:
            continue
        for factor in (x, -y, 0.5):
            total += factor * i
        if total > 20.0:
            break
    while total > 1.0 and abs(x) < 1e3:
        total *= 0.5
    # The name of a counter may be that of a number elsewhere.
    i = total + 0.25
    out[0] = i
    return total


@compiled
def pair(x, y):
    """A tuple of a tuple and a number."""
    return (x + y, x - y), x * y


@compiled
def either(x, y):
    """One of two tuples, with whole and real numbers in one place."""
    if x < 0.0:
        return 1, y
    return x, 2


@compiled
def tuples(x, y, out):
    """Tuples taken apart, put together and exchanged."""
    both, product = pair(x, y)
    a, b = both
    a, b = b, a
    whole = (*both, product)
    out[0] = out[1] = whole[0] - whole[2]
    first, second = (a, b) if x < y else (whole[2], 1.0)
    m, n = either(x, y)
    out[2] = m - 3.0 * n
    front = whole[:2]
    for k in range(3):
        first += whole[k] * k - front[1]
    return first + 2.0 * second + pair(y, x)[0][1]


@compiled
def numbers(x, y, out):
    """Whole and real numbers, their operations, and functions of math."""
    n = int(abs(x)) + 3
    half = (n + 1) / 2
    bits = (n << 1 | 1) & 6
    least, most = min(n, 4, bits), max(x, y, -1)
    rest = n % 3 + (n - 9) % 4 + x % 2.0 + n // 2 + x // 2.0
    out[0] = math.copysign(math.hypot(x, y), -x) + math.atan2(y, x) + math.ceil(x) + float(n)
    out[1] = 1.0 * (x > y) + (not x > y) * 2.0
    return half + least + most + rest + (x - y) ** 2 + math.pi + 2**COUNT


@compiled
def choices(x, y, out):
    """Conditions: chains, both, either, members, and room of their own."""
    room = row()
    room[0], room[1] = x, y
    out[0] = 1.0 if 0.0 <= x < y or not (x > 0.0 and y > 0.0) else 2.0
    if COUNT in (3, COUNT) and not math.isnan(x):
        return room[0]
    return room[1]


RULES = (loops, tuples, numbers, choices)


@pytest.fixture(scope="module")
def in_double():
    """A kernel, in double precision, of the functions above and of all walls' functions."""
    walls = list(dict.fromkeys(fitting.wall for fitting in contact_lots.FITTINGS.values()))
    surfaces = {number: wall.surface for number, wall in enumerate(walls)}
    spans = {number: wall.span for number, wall in enumerate(walls)}
    whole = Translation(intrinsics())
    whole.dispatcher("rule", dict(enumerate(RULES)), [REAL, REAL, REALS])
    whole.dispatcher("surface", surfaces, [REALS, REAL, REAL, REAL, REALS])
    whole.dispatcher("span", spans, [REALS, REALS, *[REAL] * 6, REALS])
    snippet = f"""struct Numbers {{ typedef double real;
{whole.members("rule", "surface", "span")} }};
    double* a = &wp::index(arguments, i, 0);
    double* out = &wp::index(answers, i, 1);
    double& told = wp::index(answers, i, 0);
    if (which == 0) told = Numbers::rule(number, a[0], a[1], out);
    if (which == 1) told = Numbers::surface(number, a, a[10], a[11], a[12], out);
    if (which == 2) {{
      out[0] = a[20]; out[1] = a[21]; out[2] = out[3] = 0;
      told = Numbers::span(
        number, a, a + 16, a[10], a[11], a[12], a[13], a[14], a[15], out);
    }}
"""

    @wp.func_native(snippet)
    def evaluate(
        which: int,
        number: int,
        arguments: wp.array2d(dtype=wp.float64),
        answers: wp.array2d(dtype=wp.float64),
        i: int,
    ): ...

    @wp.kernel(enable_backward=False, module="unique")
    def kernel(
        which: int,
        number: int,
        arguments: wp.array2d(dtype=wp.float64),
        answers: wp.array2d(dtype=wp.float64),
    ):
        evaluate(which, number, arguments, answers, wp.tid())

    def run(which, number, arguments):
        """Answers (n, 5): what a function returns, and what it writes."""
        answers = wp.zeros((len(arguments), 5), dtype=wp.float64)
        inputs = [which, number, wp.array(arguments, dtype=wp.float64), answers]
        wp.launch(kernel, len(arguments), inputs=inputs)
        return answers.numpy()

    return walls, run


def in_numba(function, x, y):
    """What a function returns, and writes, as numba compiles it (5,)."""
    out = np.zeros(4)
    return np.array([c_function(function, RULE).ctypes(x, y, *pointers(out)), *out])


@pytest.mark.parametrize("number", range(len(RULES)))
def test_each_rule_of_translation_computes_what_numba_does(in_double, number):
    """Each function of many constructs gives the numbers of its compiled self."""
    arguments = np.random.default_rng(2).normal(0, 3, (300, 2))
    expected = [in_numba(RULES[number], *each) for each in arguments]
    assert np.allclose(in_double[1](0, number, arguments), expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", contact_lots.FITTINGS)
def test_each_wall_is_translated_to_the_last_digits(in_double, name):
    """Distance, gradient, face and span of each fitting are those of numba, in double precision."""
    fitting, (walls, run) = contact_lots.FITTINGS[name], in_double
    number, rng = walls.index(fitting.wall), np.random.default_rng(3)
    low, high = fitting.bounds
    points = rng.uniform(low - 0.02, high + 0.02, (2000, 3))
    ways, ends = unit(rng.normal(size=points.shape)), np.array([1.0, 0.0, 1.0, 0.0])
    arguments = np.zeros((len(points), 22))
    arguments[:, : len(fitting.sizes)] = fitting.sizes
    arguments[:, 10:13], arguments[:, 13:16], arguments[:, 16:20] = points, ways, ends
    arguments[:, 20], arguments[:, 21] = -0.05, 0.05
    distances, gradients = fitting.signed_distance(points)
    told = run(1, number, arguments)
    assert np.allclose(told[:, 0], distances, rtol=0, atol=1e-13)
    assert np.allclose(told[:, 1:4], gradients, rtol=0, atol=1e-9)
    span = c_function(fitting.wall.span, SIGNATURES["span"]).ctypes
    told = run(2, number, arguments)
    for each, point, way in zip(told, points, ways, strict=True):
        out = np.array([-0.05, 0.05, 0.0, 0.0])
        within = span(*pointers(np.array(fitting.sizes), ends), *point, *way, *pointers(out))
        assert each[0] == within
        assert np.allclose(each[1:], out, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "problem", ["x = [y for y in range(3)]", "print(x)", "return x ** 3.0", "x = 'a'"]
)
def test_what_cannot_be_translated_is_refused_with_its_line(problem, tmp_path, monkeypatch):
    """The error names the file, the line and the text."""
    file = tmp_path / "odd_wall.py"
    file.write_text(f"def odd(x):\n    {problem}\n    return x\n")
    monkeypatch.syspath_prepend(tmp_path)
    odd = importlib.reload(importlib.import_module("odd_wall")).odd
    with pytest.raises(TranslationError, match=r"odd_wall\.py:2: "):
        Translation({}).function(compiled(odd), [REAL])


def test_a_model_without_walls_is_refused():
    """The error says what adds them."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(size=[1, 1, 1])
    with pytest.raises(InputError, match="has no exact walls"):
        omnitrack_sim.warp.put_model(spec.compile())


def test_relief_that_this_process_does_not_know_is_refused():
    """Its numbers are no part of a model."""
    dent = {"kind": "dent", "at": 0.2, "depth": 0.005, "length": 0.1, "width": 0.08}
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_geom(size=[0.03, 0, 0])
    pipe = {"kind": "straight", "name": "pipe", "length": 0.4, "relief": [dent]}
    ot.add_pipes(spec, ot.Network(fittings=[pipe]))
    model = spec.compile()
    omnitrack_sim.warp.put_model(model)
    uneven = model.geom_user[:, -RECORD_SIZE + LONG] > 0
    assert uneven.any()
    model.geom_user[uneven, -RECORD_SIZE + SIZES] += 1
    with pytest.raises(InputError, match="has relief"):
        omnitrack_sim.warp.put_model(model)


def test_a_fitting_that_cannot_be_translated_is_refused_by_its_kind(tmp_path, monkeypatch):
    """One of one's own, with a wall that numba takes and C++ does not."""
    (tmp_path / "listed.py").write_text(
        "import omnitrack_sim as ot\n"
        "from omnitrack_sim.pipes.compiled import Wall, compiled\n"
        "from omnitrack_sim.pipes.fittings.straight import span, surface as round_one\n"
        "@compiled\n"
        "def surface(sizes, x, y, z, out):\n"
        "    values = [x, y]\n"
        "    return round_one(sizes, values[0], values[1], z, out)\n"
        "class Listed(ot.Straight):\n"
        "    kind = 'listed'\n"
        "    wall = Wall(surface, span)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    listed = importlib.import_module("listed").Listed
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_geom(size=[0.03, 0, 0])
    ot.add_pipes(spec, ot.Assembly((Part("pipe", listed(0.4), Pose()),)))
    with pytest.raises(GeometryError, match=r"listed:Listed: its wall cannot be .*listed\.py:6"):
        omnitrack_sim.warp.put_model(spec.compile())


def test_long_networks_take_no_more_room_than_short_ones():
    """Pairs that can be near at once, of a ball, are those of some neighbours, not of all pipes."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.add_geom(size=[0.03, 0, 0])
    fittings = [{"kind": "straight", "name": f"s{i}", "length": 0.5} for i in range(60)]
    joints = [{"ports": (f"s{i}.end", f"s{i + 1}.start")} for i in range(59)]
    ot.add_pipes(spec, ot.Network(fittings=fittings, joints=joints))
    m = omnitrack_sim.warp.put_model(spec.compile())
    d = mjw.make_data(spec.compile(), nworld=3, nconmax=8, njmax=24)
    walls = m.callback.contactfilter
    assert len(walls.pairs) == 62  # with two open ends
    assert 3 * 3 <= len(walls.work(d).near) <= 3 * 7


def test_contacts_by_lot_are_those_of_mujoco():
    """None that is deeper than 10 um is missing or in vain, but for one in 1,000 beside a deeper
    one of the same body, and depths are alike."""
    assert_alike(700, seed=1)


@pytest.mark.long
def test_contacts_by_a_large_lot_are_those_of_mujoco():
    """As the small lot, of other poses."""
    assert_alike(8000, seed=2)


def assert_alike(count, seed):
    """Contacts of poses by lot, of all fittings and types of geoms, are those of MuJoCo."""
    _, told = warp_contacts.differences(warp_contacts.Lot(), count, seed)
    depths = np.array([x for each in told for x in each.depths])
    assert len(depths) > 0.9 * count
    odd = [(each, x) for each in told for x in (*each.missing, *each.in_vain) if x > NEAR]
    assert len(odd) <= count / 1000
    assert all(x < each.deepest for each, x in odd)
    assert np.quantile(depths, 0.999) < DEEP
    assert depths.max() < NEAR


# A robot that MuJoCo Warp steps, of the page. The first steps on a machine take minutes.


@pytest.fixture(scope="module")
def told():
    """What the blocks of the page define, but for that which needs a GPU."""
    names = {}
    for block in BLOCKS:
        if "ScopedCapture" not in block:
            exec(compile(block, "gpu.md", "exec"), names)
    return names


def climb(model, worlds, steps, origins=None, each=lambda m, d: None):
    """Heights of robots on their way, m (steps, worlds); `each` is called after every step."""
    m = omnitrack_sim.warp.put_model(model)
    d = mjw.make_data(model, nworld=worlds, nconmax=32, njmax=128)
    if origins is not None:
        local = d.qpos.numpy()
        local[:, :3] = model.qpos0[:3] - np.asarray(origins)
        d.qpos = wp.array(local, dtype=float)
        omnitrack_sim.warp.set_origins(m, d, origins)
    d.ctrl.fill_(0.1 / 0.025)
    heights = []
    for _ in range(steps):
        mjw.step(m, d)
        each(m, d)
        origin = m.callback.contactfilter.origins
        above = 0.0 if origin is None else origin.numpy()[:, 2]
        heights.append(d.qpos.numpy()[:, 2] + above)
    return np.array(heights)


@pytest.mark.long
def test_python_of_the_page_runs(told):
    """All of its 16 robots climb, and alike."""
    assert len(BLOCKS) == 7
    heights = told["d"].qpos.numpy()[:, 2]
    assert np.ptp(heights) < 1e-6


@pytest.mark.long
def test_a_second_of_climbing_is_that_of_mujoco(told):
    """Without a controller: within 0.01 % of the way."""
    model, data = told["model"], mujoco.MjData(told["model"])
    data.ctrl[:] = 0.1 / 0.025
    expected = []
    for _ in range(500):
        mujoco.mj_step(model, data)
        expected.append(data.qpos[2])
    heights = climb(model, 2, 500)
    way = expected[-1] - model.qpos0[2]
    assert way > 0.08
    assert np.abs(heights - np.array(expected)[:, None]).max() < 1e-4 * way


@pytest.mark.long
def test_a_world_that_is_reset_is_a_fresh_one(told):
    """Robots that are reset in the midst of others drive as those that have just been made."""
    model = told["model"]
    m = omnitrack_sim.warp.put_model(model)
    d = mjw.make_data(model, nworld=4, nconmax=32, njmax=128)

    def drive(steps):
        d.ctrl.fill_(4.0)
        for _ in range(steps):
            mjw.step(m, d)
        return d.qpos.numpy().copy()  # on the processor it is the array itself

    fresh = drive(30)
    drive(20)
    mjw.reset_data(m, d, wp.array([False, True, False, True], dtype=bool))
    again = drive(30)
    assert (again[[1, 3]] == fresh[[1, 3]]).all()
    assert (again[[0, 2]] != fresh[[0, 2]]).any(axis=1).all()


@pytest.mark.long
def test_each_world_has_its_friction_and_gravity(told):
    """On a slippery wall the robot slides down; without weight it does not."""
    model, worlds = told["model"], 3

    m = omnitrack_sim.warp.put_model(model)
    friction = np.repeat(m.geom_friction.numpy(), worlds, axis=0)
    friction[:, told["pipes"].geoms(model), 0] = np.array([0.8, 0.02, 0.02])[:, None]
    m.geom_friction = wp.array(friction, dtype=wp.vec3)
    gravity = [[0, 0, -9.81], [0, 0, -9.81], [0, 0, 0]]
    m.opt.gravity = wp.array(gravity, dtype=wp.vec3)
    d = mjw.make_data(model, nworld=worlds, nconmax=32, njmax=128)
    for _ in range(100):
        mjw.step(m, d)
    fallen = model.qpos0[2] - d.qpos.numpy()[:, 2]
    assert abs(fallen[0]) < 2e-3
    assert fallen[1] > 0.03
    assert abs(fallen[2]) < 1e-4


@pytest.mark.long
def test_far_from_the_origin_nothing_is_lost(told):
    """A hundred metres on, robots drive as at home, when their origin is there."""
    away = np.array([60.0, -80.0, 3.0])
    spec = told["spec"].copy()
    spec.body("body").pos += away
    for geom in spec.worldbody.geoms:
        geom.pos += away
    heights = climb(spec.compile(), 2, 100, origins=away)
    assert np.abs(heights - away[2] - climb(told["model"], 2, 100)).max() < 1e-6


@pytest.mark.long
def test_an_origin_that_follows_its_robot_changes_nothing(told):
    """Robots drive alike, whether their origin stays or comes after them."""
    far = 0.3
    heights = climb(told["model"], 2, 150, each=lambda m, d: omnitrack_sim.warp.recentre(m, d, far))
    stays = climb(told["model"], 2, 150)
    assert np.abs(heights - stays).max() < 2e-6


@pytest.mark.long
def test_a_ball_swings_in_a_bore_with_its_period():
    """A sphere that slides without friction: its way over two seconds is that of MuJoCo."""
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.gravity = [-9.81, 0, 0]
    angle, away = 0.3, 0.08 - 0.02
    place = [-away * math.cos(angle), away * math.sin(angle), 0.25]
    ball = spec.worldbody.add_body(pos=place)
    ball.add_freejoint()
    ball.add_geom(size=[0.02, 0, 0], mass=0.1)
    pipe = {"kind": "straight", "name": "pipe", "length": 0.5}
    ot.add_pipes(spec, ot.Network(fittings=[pipe]), friction=0.0)
    model = spec.compile()
    data, m = mujoco.MjData(model), omnitrack_sim.warp.put_model(model)
    d = mjw.make_data(model, nworld=1, nconmax=8, njmax=16)
    both = []
    for _ in range(1000):
        mujoco.mj_step(model, data)
        mjw.step(m, d)
        both.append([data.qpos[1], d.qpos.numpy()[0, 1]])
    ways = np.array(both)
    sides = ways[:-1] * ways[1:] < 0
    assert sides.sum(axis=0).min() > 6
    last = []
    for way, side in zip(ways.T, sides.T, strict=True):
        k = np.flatnonzero(side)[-1]
        last.append(k + way[k] / (way[k] - way[k + 1]))
    assert last[1] == pytest.approx(last[0], rel=1e-4)
