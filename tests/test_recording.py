"""Recordings of any MuJoCo model in exact pipes: what they hold, their films, figures and files."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pages import TOLERANCE, chromium, needs_browser, opened, picture

import omnitrack_sim as ot
from omnitrack_sim.show.film.stage import Stage
from omnitrack_sim.show.plots.style import CURVE_COLOURS
from omnitrack_sim.show.recording import FIELDS
from omnitrack_sim.show.recording_playback import RecordingPlayback
from omnitrack_sim.show.replay.document import replay_data
from omnitrack_sim.show.sources import playback_of

GEOM = mujoco.mjtGeom
PAGE = Path(__file__).parents[1] / "docs/how-to/any-robot.md"
BALL = 0.03
SIZE = {"width": 320, "height": 180}
BARE = SIZE | {"inset": False, "overlay": False}
GREEN = [0.0, 0.9, 0.0, 1.0]


def bend(position=(0.0, 0.0, 0.0)) -> ot.Network:
    """A level pipe along y, an elbow that turns within the level plane, and a pipe behind it."""
    return ot.Network(
        place={"axis": (0.0, 1.0, 0.0), "position": position},
        fittings=[
            {"kind": "straight", "name": "inlet", "length": 0.3},
            {"kind": "elbow", "name": "knee", "mean_radius": 0.24},
            {"kind": "straight", "name": "outlet", "length": 0.3},
        ],
        joints=[{"ports": ("inlet.end", "knee.start")}, {"ports": ("knee.end", "outlet.start")}],
    )


def ball_model(name: str = "ball", **walls) -> tuple[mujoco.MjModel, ot.Pipes]:
    """A green ball that lies in the level pipe, with a camera on it."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.001
    pipes = ot.add_pipes(spec, bend(), **walls)
    body = spec.worldbody.add_body(name=name, pos=[0.0, 0.1, BALL - 0.08])
    body.add_freejoint()
    body.add_geom(size=[BALL, 0, 0], mass=0.2, rgba=GREEN, condim=6, friction=[0.8, 0, 1e-4])
    body.add_camera(name="eye", fovy=90, quat=[0.5, 0.5, 0.0, 0.0])
    return spec.compile(), pipes


def recorded(model, pipes, seconds, velocity=(), **options) -> ot.Recording:
    """The recording of a model, whose first free joint begins with this velocity."""
    data = mujoco.MjData(model)
    data.qvel[: len(velocity)] = velocity
    recording = ot.Recording(model, pipes, **options)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        recording.append(data)
    return recording


@pytest.fixture(scope="module")
def rolling() -> ot.Recording:
    """A ball that rolls through the elbow."""
    return recorded(*ball_model(), 1.6, (0.0, 0.5, 0.0, -0.5 / BALL, 0.0, 0.0))


def test_the_ball_rolls_through_the_elbow(rolling):
    """It comes into each part in turn, goes on by the way that its centre has made, and stays in
    the bore."""
    names = [part.name for part in rolling.pipes.assembly.parts]
    part = rolling.places.part
    assert [names[i] for i in part[np.flatnonzero(np.diff(part, prepend=-1))]] == names
    progress, forward = rolling.progress()
    assert (np.diff(progress) > 0).all()
    assert np.linalg.norm(forward, axis=1) == pytest.approx(1.0)
    moved = np.linalg.norm(np.diff(rolling.qpos[:, :3], axis=0), axis=1).sum()
    assert 0.9 * moved < progress[-1] < 1.001 * moved
    assert (rolling.places.clearance > 0.9 * BALL).all()


def test_the_travel_of_a_playback_is_the_way_of_its_body(rolling):
    """It begins at 0 and grows by the distance between positions; the points of the drawn path are
    equal stretches of it apart, within a sample's step."""
    playback = RecordingPlayback(rolling)
    steps = np.linalg.norm(np.diff(playback.position, axis=0), axis=1)
    assert playback.travel[0] == 0.0
    assert np.diff(playback.travel) == pytest.approx(steps, abs=1e-8)
    apart = np.diff(playback.travel[playback.path])
    assert np.ptp(apart) <= 2 * steps.max()
    assert playback.path[0] == 0
    assert playback.track_travel.shape == (len(rolling), 0)  # a ball has no tracks


def test_no_two_samples_are_at_one_travel():
    """The travel grows from sample to sample, also of a body that stands still, by next to nothing:
    what is drawn along it can be looked up by it."""
    model, pipes = ball_model()
    data = mujoco.MjData(model)
    recording = ot.Recording(model, pipes, period=0.0)
    mujoco.mj_forward(model, data)
    for k in range(5):
        data.time = 0.001 * k
        recording.append(data)
    travel = RecordingPlayback(recording).travel
    assert len(travel) == 5
    assert (np.diff(travel) > 0).all()
    assert travel[-1] < 1e-6


def test_samples_are_a_period_apart():
    """From the first sample on by whole periods, also of a period that is no whole number of steps;
    with a period of 0 every state is a sample, and what a sample holds is a copy."""
    model, pipes = ball_model()
    assert recorded(model, pipes, 0.1, period=0.02).time == pytest.approx(
        0.001 + 0.02 * np.arange(5)
    )
    uneven = recorded(model, pipes, 0.1, period=0.0125).time
    assert uneven == pytest.approx(0.001 + 0.0125 * np.arange(8), abs=0.001)
    each = recorded(model, pipes, 0.02, period=0.0)
    assert len(each) == 20
    assert len(np.unique(each["qvel"], axis=0)) == 20
    assert {name: each[name].shape[0] for name in FIELDS} == dict.fromkeys(FIELDS, 20)
    with pytest.raises(KeyError, match="xpos"):
        each["xpos"]
    none = ot.Recording(model, pipes)
    shapes = {name: none[name].shape for name in FIELDS}
    assert shapes == {name: (0, *each[name].shape[1:]) for name in FIELDS}


def test_walls_carry_the_weight():
    """At rest the walls' forces add up to the ball's weight, upward, at its lowest point; the
    sign is the same for a wall and for the flat end of a cap."""
    model, pipes = ball_model()
    contacts = recorded(model, pipes, 1.0).contacts
    last = contacts.sample == contacts.sample[-1]
    assert contacts.force[last].sum(axis=0) == pytest.approx([0, 0, 0.2 * 9.81], abs=0.01)
    assert contacts.normal_force[last].sum() == pytest.approx(0.2 * 9.81, rel=0.01)
    assert contacts.position[last][0] == pytest.approx([0.0, 0.1, -0.08], abs=0.002)
    assert set(model.geom_bodyid[contacts.geom]) == {model.body("ball").id}
    spec = mujoco.MjSpec()
    fittings = [
        {"kind": "straight", "name": "a", "length": 0.3},
        {"kind": "cap", "name": "floor", "length": 0.05},
    ]
    joints = [{"ports": ("a.start", "floor.start")}]
    capped = ot.add_pipes(spec, ot.Network(fittings=fittings, joints=joints))
    body = spec.worldbody.add_body(name="ball", pos=[0.0, 0.0, 0.1])
    body.add_freejoint()
    body.add_geom(size=[BALL, 0, 0], mass=0.2)
    recording = recorded(spec.compile(), capped, 2.0)
    assert recording.wall_force()[-1] == pytest.approx(0.2 * 9.81, rel=0.01)
    assert recording.contacts.force[-1] == pytest.approx([0, 0, 0.2 * 9.81], abs=0.02)


def test_power_is_what_lifts_the_robot():
    """A motor that lifts a slide at a constant speed gives weight times speed."""
    spec = mujoco.MjSpec()
    pipes = ot.add_pipes(
        spec, ot.Network(fittings=[{"kind": "straight", "length": 1, "name": "a"}])
    )
    body = spec.worldbody.add_body(name="lift", pos=[0.0, 0.0, 0.2])
    body.add_joint(name="up", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    body.add_geom(size=[BALL, 0, 0], mass=0.2)
    motor = spec.add_actuator(name="motor", target="up", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_velocity(kv=100.0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()
    data, recording = mujoco.MjData(model), ot.Recording(model, pipes)
    data.ctrl[:] = 0.1
    for _ in range(500):
        mujoco.mj_step(model, data)
        recording.append(data)
    speed = recording["qvel"][-1, 0]
    assert recording.power()[-1] == pytest.approx(0.2 * 9.81 * speed, rel=0.01)
    assert recording.progress()[0][-1] == pytest.approx(speed * 1.0, rel=0.03)


def coloured(frame: np.ndarray) -> np.ndarray:
    """Which pixels (h, w) have the ball's colour."""
    red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
    return (green > 80) & (green > 2 * red) & (green > 2 * blue)


@pytest.mark.parametrize("camera", ["side", "follow"])
def test_films_show_the_ball_where_it_is(rolling, camera):
    """In all three parts the middle of the pixels of its colour is where the eye sees its centre,
    and around them there is the pipe that it is in."""
    playback = RecordingPlayback(rolling)
    with Stage(playback, (320, 180), camera, fine=False) as stage:
        for row in (10, 40, len(rolling) - 5):
            green = coloured(stage.paint(row))
            (place,), ahead = stage._eye.pixels(playback.position[row][None], (320, 180))
            assert ahead.all()
            rows, columns = np.nonzero(green)
            assert len(rows) > 20
            reach = 1.5 + 0.2 * np.sqrt(len(rows))
            assert np.hypot(columns.mean() - place[0], rows.mean() - place[1]) < reach
            pipe = stage.paint(row)[rows.min() - 3, int(place[0])].astype(int)
            assert pipe[2] > pipe[0] > 60, "the pipe is blue-grey, and brighter than the ground"


def test_films_draw_contacts_state_and_map(rolling):
    """The force's colour is on the ball's contact with panels or without; the camera of the model
    sees the pipe from the ball."""
    bare = ot.render_frame(rolling, time=0.8, inset=False, overlay=False, width=640, height=360)
    blue = np.round(255 * (0.12 + 0.88 * np.array(CURVE_COLOURS[0]))).astype(int)
    force = (np.abs(bare.astype(int) - blue).sum(axis=-1) < 40).sum()
    assert force > 10
    with_panels = ot.render_frame(rolling, time=0.8, camera="follow", **SIZE)
    without = ot.render_frame(rolling, time=0.8, camera="follow", **BARE)
    changed = (with_panels != without).any(axis=-1)
    assert changed[140:, :80].any()
    assert changed[:60, 240:].any()
    assert not changed[70:120].any()
    assert RecordingPlayback(rolling).cameras == ("side", "follow", "eye")
    assert ot.render_frame(rolling, time=0.8, camera="eye", **BARE).std() > 5


def test_lines_of_forces_fit_into_the_picture(rolling):
    """They begin at the contacts and lie along the forces; but for single shocks the longest is
    half a bore long."""
    forces, contacts = RecordingPlayback(rolling).forces, rolling.contacts
    lengths = []
    for row in range(len(rolling)):
        begins, lines, _ = forces.lines(row)
        of_row = contacts.sample == row
        np.testing.assert_array_equal(begins, contacts.position[of_row])
        assert np.cross(lines, contacts.force[of_row]) == pytest.approx(0.0, abs=1e-9)
        lengths += np.linalg.norm(lines, axis=1).tolist()
    assert np.percentile(lengths, 98) == pytest.approx(0.08, rel=0.05)


def test_films_and_strips_are_whole_files(rolling, tmp_path):
    """The same recording gives the same bytes."""
    small = {"width": 64, "height": 36, "fps": 2}
    films = [
        ot.render_video(rolling, path=tmp_path / f"{n}.gif", processes=n, **small) for n in (1, 2)
    ]
    assert films[0].read_bytes() == films[1].read_bytes()
    path = tmp_path / "strip.png"
    strip = ot.render_strip(rolling, path=path, times=[0.1, 0.9], width=64, height=48)
    assert strip.stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.gif", "2.gif", "strip.png"]


@pytest.mark.long
@needs_browser
def test_pages_hold_the_true_positions(rolling, tmp_path):
    """Position and orientation of the body at samples and between them, the part that it is in, and
    its way; the arrows add up to the wall's force."""
    path = tmp_path / "run.html"
    assert ot.render_replay(rolling, path=path).html == path.read_text(encoding="utf-8")
    assert ot.render_replay(rolling).html == path.read_text(encoding="utf-8")
    bodies, (way, _) = rolling.bodies[:, 1], rolling.progress()
    with chromium() as browser, opened(browser, path, hash="#camera=onboard") as page:
        assert page.evaluate("replay.cameras.mode") == "onboard"
        for row in (0, 20, 55, 79):
            page.evaluate(f"replay.seek({rolling.time[row]})")
            pose = page.evaluate("replay.pose('ball')")
            assert pose["position"] == pytest.approx(bodies[row, :3], abs=TOLERANCE)
            assert abs(np.dot(pose["quaternion"], bodies[row, 3:])) == pytest.approx(1, abs=1e-6)
            shown = page.evaluate("replay.draw(), document.getElementById('state').textContent")
            assert shown.startswith(
                "in " + rolling.pipes.assembly.parts[rolling.places.part[row]].name
            )
            assert f"{1e3 * way[row]:.0f} mm" in shown
            arrows = page.evaluate(
                "replay.motions[0].arrows.map(a => a.force.map(c => replay.motions[0].between(c)))"
            )
            force = rolling.contacts.force[rolling.contacts.sample == row].sum(axis=0)
            assert np.sum(arrows, axis=0) == pytest.approx(force, abs=0.01)
        half = (rolling.time[20] + rolling.time[21]) / 2
        page.evaluate(f"replay.seek({half})")
        middle = (bodies[20, :3] + bodies[21, :3]) / 2
        assert page.evaluate("replay.pose('ball').position") == pytest.approx(middle, abs=TOLERANCE)
        page.get_by_role("button", name="follow", exact=True).click()
        assert picture(page).std() > 10


def test_figures_show_the_way_and_what_was_measured(rolling, tmp_path):
    """Two views of the pipes with the way, and a panel for each curve; the same bytes again."""
    figure = ot.plot_summary(rolling, path=tmp_path / "a.png")
    ot.plot_summary(rolling, path=tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    titles = [axis.get_ylabel() for axis in figure.axes[2:]]
    assert titles[:3] == [
        "Way along the pipes [m]",
        "Speed along the pipes [mm/s]",
        "Clearance of the body [mm]",
    ]
    plan = next(axis for axis in figure.axes[:2] if "plan" in axis.get_title(loc="left"))
    line = max(plan.get_lines(), key=lambda line: len(line.get_xdata()))
    drawn = np.sort(np.abs(np.transpose(line.get_data())), axis=None)
    assert drawn == pytest.approx(np.sort(np.abs(rolling.qpos[:, :2]), axis=None))


def test_what_cannot_be_drawn_has_its_figure(tmp_path):
    """A robot of hidden geoms has no picture, which the error says, but its curves."""
    spec = mujoco.MjSpec()
    pipes = ot.add_pipes(spec, bend())
    body = spec.worldbody.add_body(name="ball", pos=[0.0, 0.1, BALL - 0.08])
    body.add_freejoint()
    body.add_geom(size=[BALL, 0, 0], group=3)
    recording = recorded(spec.compile(), pipes, 0.1)
    assert len(ot.plot_summary(recording).axes) > 6
    with pytest.raises(ot.InputError, match="no visible geom"):
        ot.render_strip(recording, path=tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_pipes_can_be_seen_by_mujocos_own_renderer(monkeypatch):
    """From within the bore, and from outside through the nearer wall; nothing else changes, and a
    recording shows the same."""
    # MuJoCo chooses its platform when it is imported, which was before.
    egl = pytest.importorskip("mujoco.egl")
    monkeypatch.setattr("mujoco.rendering.classic.gl_context.GLContext", egl.GLContext)
    frames, recordings = [], []
    for visible in (False, True):
        model, pipes = ball_model(visible=visible)
        recordings.append(recorded(model, pipes, 0.3))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        view = mujoco.MjvCamera()
        view.lookat[:], view.distance, view.elevation = [0.0, 0.15, 0.0], 1.0, -60.0
        with mujoco.Renderer(model, 90, 160) as renderer:
            for camera in ("eye", view):
                renderer.update_scene(data, camera)
                frames.append(renderer.render().astype(int))
    hidden, shown = frames[:2], frames[2:]
    for before, after in zip(hidden, shown, strict=True):
        assert (np.abs(after - before).sum(axis=-1) > 30).mean() > 0.05
    assert coloured(shown[1]).sum() == coloured(hidden[1]).sum() > 10
    np.testing.assert_array_equal(recordings[0].qpos, recordings[1].qpos)
    assert recordings[1].model.body_mass.sum() == recordings[0].model.body_mass.sum()
    one, other = (ot.render_frame(recording, time=0.2, **SIZE) for recording in recordings)
    np.testing.assert_array_equal(one, other)


def test_a_saved_recording_is_the_same(rolling, tmp_path):
    """Bytes, samples, contacts, places and pictures; and it goes on."""
    path = rolling.save(tmp_path / "run.npz")
    loaded = ot.Recording.load(path)
    assert loaded.save(tmp_path / "again.npz").read_bytes() == path.read_bytes()
    for name in ("time", *FIELDS):
        np.testing.assert_array_equal(loaded[name], rolling[name])
    for one, other in zip(loaded.contacts, rolling.contacts, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(loaded.places.arc_length, rolling.places.arc_length)
    one, other = (ot.render_frame(each, time=0.8, **SIZE) for each in (loaded, rolling))
    np.testing.assert_array_equal(one, other)
    data = mujoco.MjData(loaded.model)
    data.time = 2.0
    assert loaded.append(data)
    assert len(loaded) == len(rolling) + 1
    assert repr(loaded).startswith("Recording(81 samples")


def test_a_page_shows_two_recordings_through_the_same_pipes(rolling, tmp_path):
    """Also of a file; one through other pipes is refused."""
    model, pipes = ball_model()
    slower = recorded(model, pipes, 0.1).save(tmp_path / "slower.npz")
    first, second = RecordingPlayback(rolling), playback_of(slower)
    runs = replay_data(first, second)["runs"]
    assert [run["heading"]["duration"] for run in runs] == pytest.approx([1.58, 0.08])
    assert ot.render_replay(rolling, compare=slower).html.count("recording of ball") >= 2
    spec = mujoco.MjSpec()
    moved = ot.add_pipes(spec, bend((0.0, 0.0, 0.5)))
    body = spec.worldbody.add_body(name="ball", pos=[0.0, 0.1, 0.5])
    body.add_freejoint()
    body.add_geom(size=[BALL, 0, 0])
    with pytest.raises(ot.InputError, match="other pipes"):
        ot.render_replay(rolling, compare=recorded(spec.compile(), moved, 0.1))


def test_damaged_files_are_refused(rolling, tmp_path):
    """Whatever is cut off or missing, and a file of another release."""
    whole = rolling.save(tmp_path / "run.npz").read_bytes()
    for data in (b"", whole[: len(whole) // 2], b"no zip"):
        (tmp_path / "bad.npz").write_bytes(data)
        with pytest.raises(ot.OutputError, match=r"bad\.npz"):
            ot.Recording.load(tmp_path / "bad.npz")
    arrays = dict(np.load(tmp_path / "run.npz"))
    for name, value in (
        ("qpos", arrays["qpos"][:, :3]),
        ("head", np.frombuffer(arrays["head"].tobytes().replace(b'"4.', b'"3.'), np.uint8)),
        ("model", arrays["model"][:100]),
    ):
        np.savez(tmp_path / "bad.npz", **arrays | {name: value})
        with pytest.raises(ot.OutputError, match=r"bad\.npz"):
            ot.Recording.load(tmp_path / "bad.npz")
    with pytest.raises(ot.OutputError, match="missing"):
        ot.Recording.load(tmp_path / "nothing.npz")


def test_what_cannot_be_recorded_is_refused(tmp_path):
    """With its reason, before anything is written."""
    model, pipes = ball_model()
    with pytest.raises(TypeError, match="MjModel"):
        ot.Recording(mujoco.MjSpec(), pipes)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="add_pipes"):
        ot.Recording(model, bend())  # type: ignore[arg-type]
    with pytest.raises(ot.InputError, match="no wall of the part 'inlet'"):
        ot.Recording(mujoco.MjModel.from_xml_string("<mujoco/>"), pipes)
    with pytest.raises(ot.InputError, match="did you mean 'ball'"):
        ot.Recording(model, pipes, body="bal")
    for period in (-1.0, float("inf"), float("nan")):
        with pytest.raises(ot.InputError, match="period"):
            ot.Recording(model, pipes, period=period)
    recording, data = ot.Recording(model, pipes), mujoco.MjData(model)
    with pytest.raises(ot.InputError, match="no samples"):
        ot.render_video(recording, path=tmp_path / "a.gif")
    with pytest.raises(ot.InputError, match="no samples"):
        ot.render_replay(recording, path=tmp_path / "a.html")
    with pytest.raises(ot.InputError, match="no samples"):
        ot.plot_summary(recording, path=tmp_path / "a.png")
    data.time = 1.0
    assert recording.append(data)
    assert not recording.append(data)
    data.time = 0.0
    with pytest.raises(ot.InputError, match="begin a new Recording"):
        recording.append(data)
    data.qvel[:] = np.nan
    mujoco.mj_step(model, data)
    with pytest.raises(ot.InputError, match="diverged"):
        recording.append(data)
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ot.InputError, match="another model"):
        recording.append(mujoco.MjData(other))
    with pytest.raises(ot.InputError, match="no camera 'onboard'"):
        ot.render_video(recording, path=tmp_path / "a.gif", camera="onboard")
    with pytest.raises(ot.InputError, match="format"):
        recording.save(tmp_path / "a.zip")
    with pytest.raises(ot.InputError, match="format"):
        ot.plot_summary(recording, path=tmp_path / "a.gif")
    for render in (ot.render_replay, ot.render_video):
        with pytest.raises(ot.InputError, match="format"):
            render(recording, path=tmp_path / "a.png")
    with pytest.raises(ot.InputError, match=r"times\[0\]"):
        ot.render_strip(recording, path=tmp_path / "a.png", times=[2.0])
    assert not list(tmp_path.iterdir())
    spec = mujoco.MjSpec()
    moving = spec.worldbody.add_body(name="frame")
    moving.add_freejoint()
    moving.add_geom(size=[0.01, 0, 0])
    carried = ot.add_pipes(spec, bend(), body=moving)
    with pytest.raises(ot.InputError, match="pipes on a body"):
        ot.Recording(spec.compile(), carried)


def test_geoms_of_every_shape_are_drawn():
    """Also a mesh that is not closed; planes, hidden groups and clear geoms are not."""
    spec = mujoco.MjSpec()
    pipes = ot.add_pipes(
        spec, ot.Network(fittings=[{"kind": "straight", "length": 1, "name": "a"}])
    )
    sheet = [[0, 0, 0], [0.04, 0, 0], [0, 0.04, 0], [0, 0, 0.04]]
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1]]
    spec.add_mesh(name="sheet", uservert=np.ravel(sheet), userface=np.ravel(faces))
    spec.mesh("sheet").inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=GEOM.mjGEOM_PLANE, size=[1, 1, 1])
    shapes = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
    for number, shape in enumerate(shapes):
        body = spec.worldbody.add_body(name=shape, pos=[0.0, 0.0, 0.1 + 0.12 * number])
        body.add_freejoint()
        more = {"meshname": "sheet"} if shape == "MESH" else {"size": [0.03, 0.02, 0.02]}
        body.add_geom(type=getattr(GEOM, f"mjGEOM_{shape}"), rgba=GREEN, **more)
        body.add_geom(size=[0.04, 0, 0], group=3, rgba=[1, 0, 0, 1], contype=0)
        body.add_geom(size=[0.04, 0, 0], rgba=[1, 0, 0, 0], contype=0)
    model = spec.compile()
    recording, data = ot.Recording(model, pipes, body="MESH"), mujoco.MjData(model)
    recording.append(data)
    playback = RecordingPlayback(recording)
    assert len(playback.visible_geoms) == len(shapes)
    with Stage(playback, (320, 180), "side", fine=False) as stage:
        frame = stage.paint(0)
        places, _ = stage._eye.pixels(recording.bodies[0, 1:, :3], (320, 180))
    green = coloured(frame)
    for shape, (column, row) in zip(shapes, places, strict=True):
        around = green[int(row) - 3 : int(row) + 4, int(column) - 3 : int(column) + 4]
        assert around.any(), shape
    assert not ((frame[..., 0] > 150) & (frame[..., 1] < 60)).any()


def test_the_section_of_the_page_runs(tmp_path, monkeypatch):
    """Its lines make all of their files, of the robot of the page; of a tenth of a second here."""
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)[0]
    lines = re.search(r"```text\n(recording = .*?)```", text, flags=re.DOTALL)
    assert lines is not None
    short = lines[1].replace("data.time < 8", "data.time < 4.1")
    exec(compile(f"{code}\n{short}", "any-robot.md", "exec"), {"__name__": "page"})
    made = ["figure.png", "run.html", "run.mp4", "run.npz", "run.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == made
    assert len(ot.Recording.load("run.npz")) == 6


@pytest.mark.parametrize(("name", "told"), [("ball", "ball"), ("", "the robot")])
def test_a_recording_is_of_its_body_by_name(name, told):
    """A body without a name is the robot."""
    playback = RecordingPlayback(recorded(*ball_model(name), 0.02))
    assert playback.name == f"recording of {told}"
