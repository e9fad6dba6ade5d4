"""Page, film and figures of a robot of a user's own: legends, bars, arrows and tables by body."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from matplotlib.figure import Figure
from own_crawler import HULL, MOTORS, WHEELS, crawl, crawler_xml

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.reading import checked
from omnitrack_sim.base.rotations import matrix_from_quaternion
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.recorded import Recorded, values_of
from omnitrack_sim.show.film.overlay import _shortened, font
from omnitrack_sim.show.film.painter import DAYLIGHT, GROUND
from omnitrack_sim.show.film.render import stage_of
from omnitrack_sim.show.legend import (
    MAX_NAMED,
    Legend,
    Parts,
    colours,
    legends_of,
    merged,
    short_names,
)
from omnitrack_sim.show.playback import Playback
from omnitrack_sim.show.plots.run_figures import line_styles
from omnitrack_sim.show.recording_playback import RecordingPlayback, shown_samples
from omnitrack_sim.show.replay.document import replay_data
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.surfaces import MARK_APART, geoms_surface, rings
from omnitrack_sim.show.viewer.player import SavedRun
from omnitrack_sim.show.wall_forces import MAX_BARS, ForceBars


@pytest.fixture(scope="module")
def climb(tmp_path_factory) -> ot.Result:
    """Four seconds of the crawler, into the elbow."""
    return crawl(tmp_path_factory.mktemp("crawler"), 5.0)


@pytest.fixture(scope="module")
def playback(climb) -> RunPlayback:
    """The playback of that run."""
    return RunPlayback(climb)


def test_short_names_stay_different():
    """Words that all share go, unless two names or nothing would be left."""
    assert short_names(WHEELS)[0] == "front top centre"
    assert len(set(short_names(WHEELS))) == len(WHEELS)
    assert short_names(["leg_1", "leg"]) == ["leg_1", "leg"]
    assert short_names(["leg 1", "leg_1"]) == ["leg 1", "leg_1"]
    assert short_names(["alone"]) == ["alone"]


def test_colours_are_apart():
    """Of any number of parts no two have the same, and few have those of all curves."""
    for count in (1, 6, 7, 40):
        assert len(set(colours(count))) == count


def test_a_motor_has_the_colour_of_its_wheel(playback):
    """Bodies that touch have a colour each; the hull, which does not, has none; both kinds of parts
    are one legend, as their short names are the same."""
    bodies, motors = (playback.legends[each] for each in ("body", "actuator"))
    paint = dict(zip(bodies.names, bodies.colours, strict=True))
    assert {name for name, colour in paint.items() if colour is not None} == set(WHEELS)
    assert paint[HULL] is None
    assert dict(zip(motors.names, motors.colours, strict=True)) == {
        motor: paint[wheel] for motor, wheel in zip(MOTORS, WHEELS, strict=True)
    }
    assert [legend.heading for legend in merged(playback.legends.values())] == ["bodies, actuators"]


def test_parts_that_share_a_body_have_colours_of_their_own():
    """Two joints of one body would not be told apart by its colour; of many parts a legend names
    the ends."""
    bodies = Parts("body", ("a", "b"), (1, 2), (True, True))
    joints = Parts("joint", ("x", "y", "z"), (1, 1, 2), (True, True, True))
    legends = legends_of([bodies, joints])
    assert len(set(legends["joint"].colours)) == 3
    many = tuple(f"link_{i}" for i in range(MAX_NAMED + 3))
    legends = legends_of([Parts("body", many, tuple(range(1, 16)), (True,) * 15)])
    legend = legends["body"]
    playback = Playback()
    playback.__dict__["legends"] = legends
    assert playback.badges == (), "which numbers only a few bodies"
    assert [row[0] for row in legend.rows] == ["0", "to 14, 14 more"]
    assert len(set(legend.colours)) == len(many)


def test_arrows_are_the_recorded_forces(climb, playback):
    """At each sample those of a body add up to its recorded force, along the wall's normal, and the
    film's lines have its colour."""
    trajectory, forces = climb.trajectory, playback.forces
    names = trajectory.schema["wall_force"].names
    legend = playback.legends["body"]
    sizes = np.linalg.norm(forces.force, axis=1)
    for column, name in enumerate(names):
        if name not in WHEELS:
            continue
        mine = (forces.colour == legend.colours[column]).all(axis=1)
        total = np.bincount(forces.sample[mine], sizes[mine], len(trajectory.time))
        recorded = trajectory["wall_force"][:, column]
        seen = total > 0
        assert seen[recorded > 1].mean() > 0.99
        assert total[seen] == pytest.approx(recorded[seen], rel=1e-9)
    assert (sizes > 0).all()
    pushes = [arrow.force for arrow in playback.arrows]
    assert len(pushes) == len(WHEELS)
    straight = trajectory["distance"] < 0.3
    for push in pushes:  # into the bore of a pipe that stands
        assert np.abs(push[straight][:, 2]).max() < 0.02 * np.abs(push[straight]).max()


def test_the_panel_has_a_bar_for_each_body_that_touches(playback):
    """Its text is the force, its colour that of the curves; what never touches has none."""
    row = len(playback.time) // 2
    bars = playback.status(row).bars
    forces = playback.trajectory["wall_force"][row]
    names = playback.trajectory.schema["wall_force"].names
    assert 0 < len(bars) <= MAX_BARS
    assert [bar.label for bar in bars] == short_names(WHEELS)
    assert [bar.text for bar in bars] == [f"{forces[names.index(name)]:.1f}" for name in WHEELS]
    assert all(0 <= bar.share <= 1 and not bar.has_sign for bar in bars)


def test_of_many_bodies_those_that_press_hardest_have_bars():
    """In their order; the scale is that of large forces, and what never touches has none."""
    count = 2 * MAX_BARS
    names = tuple(f"b{k}" for k in range(count))
    colours = ((0.5, 0.5, 0.5),) * (count - 1) + (None,)
    forces = np.tile((np.arange(count, dtype=float) * 5) % count, (3, 1))
    bars = ForceBars(Legend("bodies", names, names, colours, tuple(range(count))), forces).at(1)
    hardest = sorted(np.argsort(-forces[0, :-1])[:MAX_BARS].tolist())
    assert [bar.label for bar in bars] == [names[k] for k in hardest]
    assert [bar.text for bar in bars] == [f"{forces[0, k]:.1f}" for k in hardest]


def test_the_window_tells_the_bodies_that_press_hardest(climb, playback):
    """Below the force of all, the hardest first."""
    row = len(playback.time) // 2
    routes = RouteMap(climb.routes())
    lines = SavedRun(playback, climb)
    lines.leap(row)
    told = climb.scenario.robot.display.measurements(playback.moment(row), routes, lines.location)
    forces = [(name.strip(), float(text)) for name, text in told if name.startswith("  ")]
    assert {name for name, _ in forces} <= set(WHEELS)
    values = [force for _, force in forces]
    assert values == sorted(values, reverse=True)
    assert sum(values) == pytest.approx(float(dict(told)["wall force, N"]), abs=0.5)


def test_pages_name_every_line(playback):
    """Each line of a plot is a body's or an actuator's of the legend, or has its name beside its
    value; badges are numbered as in the legend."""
    data = replay_data(playback)
    [legend] = data["legends"]
    paints = {row[2] for row in legend["rows"]}
    assert [row[3] for row in legend["rows"]] == [text for _, text, _ in badges(data)]
    assert paints == {colour for *_, colour in badges(data)}
    for panel in data["panels"]:
        columns = data["runs"][0]["curves"][panel["channel"]]["columns"]
        assert columns > 0, panel["channel"]
        if columns > 1:
            shown = [name for name in panel["names"] if name is not None]
            assert shown, panel["channel"]
            if panel["told"]:
                assert set(filter(None, panel["colours"])) == paints
    assert {arrow["kind"] for arrow in data["runs"][0]["arrows"]} == {"normal_force"}
    assert all(part["marks"] for part in data["pipes"]["parts"])


def badges(data) -> list:
    """The badges of the first run of a page."""
    return data["runs"][0]["robot"]["badges"]


def panels(figure: Figure) -> list:
    """The panels of a figure with lines in them."""
    return [axis for axis in figure.axes if axis.lines]


def test_no_panel_is_empty(tmp_path, climb):
    """Of a robot without actuators the summary has no panel of them, nor has its page; with them
    there are nine, and the legend names the wheels."""
    idle = crawl(tmp_path, 0.2, driven=False)
    figure = ot.plot_summary(idle)
    titles = [axis.get_ylabel() for axis in figure.axes]
    assert len(panels(figure)) == len(figure.axes) == 5
    assert not any("ctuator" in title or "nputs" in title for title in titles)
    names = [panel["channel"] for panel in replay_data(RunPlayback(idle))["panels"]]
    assert "ctrl" not in names
    assert "wall_force" in names
    full = ot.plot_summary(climb)
    assert len(panels(full)) == 9
    texts = {text.get_text() for legend in full.legends for text in legend.get_texts()}
    assert texts == set(short_names(WHEELS))


def test_a_recording_ends_where_the_body_has_left_for_good():
    """The last sample that is shown is the first one outside, unless it comes back."""
    assert shown_samples(np.array([True, True, False, False])) == 3
    assert shown_samples(np.array([True, False, True])) == 3
    assert shown_samples(np.array([False, False])) == 2
    assert shown_samples(np.array([True, False])) == 2


@pytest.fixture(scope="module")
def leaving() -> ot.Recording:
    """A crawler that climbs out of the upper end of a straight pipe."""
    spec = mujoco.MjSpec.from_string(crawler_xml())
    spec.body(HULL).quat = [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]  # its x points up
    network = ot.Network(fittings=[{"kind": "straight", "name": "riser", "length": 0.3}])
    pipes = ot.add_pipes(spec, network, friction=0.8)
    model = spec.compile()
    data, recording = mujoco.MjData(model), ot.Recording(model, pipes, period=0.05)
    data.ctrl[:] = 8.0  # 0.2 m/s
    while data.time < 1.5:
        mujoco.mj_step(model, data)
        recording.append(data)
    return recording


def test_what_has_left_the_pipe_says_when(leaving):
    """Page, film and figure end with the first sample outside, and an event tells its time."""
    inside = leaving.places.part >= 0
    assert inside.any()
    assert not inside[-2:].any()
    shown = RecordingPlayback(leaving)
    assert len(shown.time) == np.flatnonzero(inside)[-1] + 2
    assert shown.unshown == len(leaving) - len(shown.time)
    [(time, words)] = shown.events
    assert time == shown.time[-1]
    assert words == f"{HULL} left the pipes; {shown.unshown} later samples are not shown"
    assert shown.heading["outcome"] == "left the pipes"
    least = next(row for row in shown.heading["figures"] if row["unit"] == "mm")
    assert 70 < least["value"] <= 80


def test_a_camera_that_has_left_the_pipe_says_so(leaving):
    """The panel of its film does, from the first sample on at which it looks out of the end."""
    shown = RecordingPlayback(leaving)
    with stage_of(shown, (1280, 720), "eye") as stage:
        titles = [stage._panels[0]._status(row).title for row in range(len(shown.time))]
    left = [title.startswith("camera has left the pipes, ") for title in titles]
    eye = leaving.bodies[: len(left), shown.body, 2] + 0.072  # above the hull's middle
    assert left == (eye > 0.3).tolist()
    assert any(left)
    assert not all(left)


def test_tables_name_bodies_joints_and_actuators(leaving):
    """A row a sample; columns carry the model's names, and have units; forces add up."""
    pytest.importorskip("pandas")
    table = leaving.to_pandas()
    assert len(table) == len(leaving)
    names = {"time", "qpos_root_x", "qpos_spin_0", "qvel_root_wz", "part", "distance"}
    names |= {f"ctrl_{MOTORS[0]}", f"position_{WHEELS[2]}_y", f"wall_force_{WHEELS[5]}"}
    assert names <= set(table.columns)
    assert set(table.attrs["units"]) == set(table.columns)
    assert table["part"].iloc[0] == "riser"
    assert table["part"].iloc[-1] == ""
    forces = table[[f"wall_force_{wheel}" for wheel in WHEELS]].sum(axis=1)
    assert forces.to_numpy() == pytest.approx(leaving.wall_force())
    assert table[f"position_{HULL}_z"].to_numpy() == pytest.approx(leaving.qpos[:, 2])


def test_columns_of_a_run_are_named_by_body(climb, tmp_path):
    """In Parquet and pandas, those of actuators by theirs; a saved run has the same values."""
    columns = [column for column, _, _ in climb.trajectory.columns()]
    names = {f"wall_force_{wheel}" for wheel in (*WHEELS, HULL)}
    names |= {f"{what}_{motor}" for what in ("ctrl", "actuator_power") for motor in MOTORS}
    assert names <= set(columns)
    again = ot.load_result(climb.save(tmp_path / "run")).trajectory
    for name in ("wall_force", "ctrl"):
        np.testing.assert_array_equal(again[name], climb.trajectory[name])
    twice = ot.Channel("grip", (2,), "N", "two alike", names=("a", "a"))
    assert twice.columns == ("grip_1", "grip_2")


def test_contacts_are_a_table(leaving):
    """A row a contact, with the names of body, geom and part; forces are those of the walls."""
    pytest.importorskip("pandas")
    table = leaving.contacts_to_pandas()
    assert len(table) == len(leaving.contacts.sample)
    assert set(table["body"]) <= set(WHEELS) | {HULL}
    assert set(table["part"]) <= {"riser", ""}  # the last ones are at the open end's rim
    assert table["part"].iloc[0] == "riser"
    by_time = table.groupby("sample")["normal_force"].sum()
    assert by_time.to_numpy() == pytest.approx(leaving.wall_force()[by_time.index])
    assert table.attrs["units"]["force_x"] == "N"


def test_wheels_are_round(leaving):
    """The rim of a drawn cylinder is within a tenth of a millimetre of a circle of 25 mm, in films
    and in pages."""
    model = leaving.model
    wheel = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)[0])
    for fine in (False, True):
        surface = geoms_surface(model, [wheel], fine)
        own = (surface.position - model.geom_pos[wheel]) @ matrix_from_quaternion(
            model.geom_quat[wheel]
        )
        corners = own[np.hypot(*own[:, :2].T) > 0.9 * 0.025]
        angles = np.unique(np.arctan2(corners[:, 1], corners[:, 0]).round(6))
        gap = np.diff(angles, append=angles[0] + 2 * np.pi).max()
        assert 0.025 * (1 - np.cos(gap / 2)) < 1e-4


def test_rings_lie_on_the_wall_and_leave_mouths_open():
    """Half a bore apart, seen from within; none of a tee crosses the branch's mouth."""
    for part in ot.load_scenario("tee_turn").route.network.parts:
        marks = rings(part)
        assert marks, part.name
        bore = 2 * part.fitting.radius
        for mark in marks:
            distance, inward = part.signed_distance(mark.position)
            used = np.unique(mark.faces)
            assert np.abs(distance[used]).max() < 0.02 * bore
            corners = mark.position[mark.faces]
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert ((across * inward[mark.faces[:, 0]]).sum(axis=1) > 0).all()
        if part.fitting.kind == "straight":
            length = part.axes[0][0].length
            assert len(marks) == np.arange(MARK_APART * bore, length, MARK_APART * bore).size


@pytest.fixture(scope="module")
def watched() -> ot.Recording:
    """A crawler in a pipe that stands, seen by a camera of the world beside it, too."""
    camera = "<camera name='corner' pos='0.7 0 0.2' xyaxes='0 1 0 0 0 1'/>"
    spec = mujoco.MjSpec.from_string(crawler_xml(more=camera))
    spec.body(HULL).quat = [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]
    fittings = [{"kind": "straight", "name": "riser", "length": 0.6}]
    pipes = ot.add_pipes(spec, ot.Network(fittings=fittings), friction=0.8)
    model = spec.compile()
    data, recording = mujoco.MjData(model), ot.Recording(model, pipes, period=0.05)
    mujoco.mj_step(model, data)
    recording.append(data)
    return recording


def test_a_camera_outside_sees_the_pipe_cut(watched):
    """It sees the robot in front of the pipe's far wall, on the ground of outside views, and the
    panel says that it looks from outside; a camera in the bore has no such words."""
    size = (320, 180)
    with stage_of(RecordingPlayback(watched), size, "corner", overlay=False) as stage:
        picture = stage.paint(0).astype(int)
    assert np.abs(picture[10, 10] - np.round(255 * np.array(GROUND))).max() <= 2
    red, _, blue = np.moveaxis(picture[60:120, 130:190], -1, 0)
    assert (red > blue + 60).sum() > 50, "the robot is orange"
    assert (blue > red + 10).sum() > 50, "the wall behind it is blue-grey"
    for camera, outside in (("corner", True), ("eye", False)):
        with stage_of(RecordingPlayback(watched), (1280, 720), camera) as stage:
            title = stage._panels[0]._status(0).title
            assert title.startswith("seen from outside, ") is outside


def test_daylight_comes_through_an_open_end(watched):
    """A camera in the bore sees it in the middle, with the wall round it darker farther on."""
    with stage_of(RecordingPlayback(watched), (320, 180), "eye", overlay=False) as stage:
        picture = stage.paint(0).astype(int)
    assert np.abs(picture[90, 160] - np.round(255 * np.array(DAYLIGHT))).max() <= 2
    assert picture[90, 5].sum() > picture[90, 110].sum()


def test_labels_of_bars_keep_both_ends():
    """Names of links that differ in their last letter stay apart where they are shortened."""
    letters = font(15)
    names = [f"articulated body link number {i}" for i in range(12)]
    shown = [_shortened(name, letters, 120) for name in names]
    assert len(set(shown)) == len(names)
    assert all(letters.getlength(text) <= 120 for text in shown)
    assert all(text.startswith("artic") for text in shown)
    assert _shortened("front", letters, 120) == "front"


def test_lines_of_many_parts_differ_in_colour_and_dashes():
    """Of twelve named parts neighbours in the ramp have other dashes; six have colours enough, and
    of a chain of thirty the ramp is seen whole."""
    for count, kinds in ((6, 0), (12, 3), (30, 0)):
        names = tuple(f"joint_{i}" for i in range(count))
        parts = Parts("actuator", names, tuple(range(1, count + 1)), (True,) * count)
        legends = legends_of([parts])
        styles = line_styles(legends.values())
        assert len(set(styles.values())) == kinds
        own = [styles.get(colour) for colour in legends["actuator"].colours if colour]
        assert not kinds or all(a != b for a, b in pairwise(own))


@pytest.mark.parametrize("robot", [ot.Omnitrack(), Presser()], ids=lambda robot: robot.kind)
def test_a_saved_robot_is_shown_by_the_choices_that_its_run_kept(robot):
    """Camera, figures and pages; its model is not asked for them."""
    given = {"table": "{}", "file": "", "values": values_of(robot, robot.channels)}
    kept = checked(Recorded, given, InputError).display
    for name in ("camera", "plots", "headline", "columns", "summary"):
        assert getattr(kept, name) == getattr(robot.display, name), name
