"""Tuned constants of recognition."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from omnitrack_sim.base.rotations import Array

FREE = 10.0
"""Standard deviation of a number of a camera that a picture alone tells, m or rad."""


def numbers(aside: float, tilt: float, distance: float, turn: float) -> Array:
    """Return values (6,) for the six numbers of a camera, which are alike across the pipe.

    Args:
        aside: m, of both places across it.
        tilt: rad, of both tilts.
        distance: m.
        turn: rad.
    """
    return np.array([aside, aside, tilt, tilt, distance, turn])


def _both_ways(*angles_deg: float) -> Array:
    """Return 0 and ascending angles either way, rad, from their sizes in degrees."""
    return np.radians([0.0, *(-angle for angle in angles_deg[::-1]), *angles_deg])


def _around(reach: float, step: float) -> Array:
    """Return offsets every ``step`` from ``-reach`` to ``reach``."""
    return np.arange(-reach, reach + step / 20, step)


@dataclass(frozen=True, eq=False)
class RecogniserSettings:
    """Extent of the library, of the search and of the fit, and thresholds of a detection.

    Costs are squared residuals in standard deviations, bounded by the robust loss.

    Attributes:
        behind: m, length of the modelled straight before a fitting.
        beyond: m, length of the straights beyond it; the robust loss absorbs what follows.
        scale_values: pixel values at which the scale of equal noise is tabulated.
        ring_rays: rays of each ring of a coarse picture, and directions of a form in the library.
        rings: (14,) angles of the rings from the axis, as parts of half the field of view.
        library_distances: (24,) bores, distances of a form in the library; negative ones are those
            of a lens that is in the fitting already.
        exposed_part: part of half the field of view from which on rays stand for the whole picture
            in its exposure: they see nearly straight pipe, whatever lies ahead.
        exposed_rays: about how many of them.
        library_blur: standard deviations by which a coarse picture is off besides the library's
            steps: the camera's pose is roughly known, and sizes are those of the starts.
        library_cap: most that a ray of a coarse picture can cost.
        starts: starting values of each form that are followed, besides those at visible joints.
        distinct_distance: bores, from which on two starts of a form differ.
        distinct_turn: rad, the same of directions.
        joint_distance: bores, from a visible joint to an entry of the library that it may be.
        excluded_cost: cost in the library from which on a fitting would have been visible.
        excluded_together: entries that are compared by pixels at a time, the nearest first.
        followed: most rows that are followed: roughly, closely, to the end.
        follow_cost: cost above the least from which on rows are not followed, for the same stages.
        follow_forms: number of forms of which the best row is always followed, for the same
            stages: a start between two entries of the library misses by much.
        rough_turns: (11,) rad, directions tried beside that of each row, its own first.
        fine_turns: (7,) rad, the same in the end.
        few_starts: starting sizes of a form up to which the rough search tries all once more; forms
            with more begin again on their own.
        restart_offsets: (11,) m, positions beside the first at which the search for a bend or a
            reducer begins again: start and sizes of a bend and the camera's tilt are nearly
            confounded.
        restart_length: least lengths of a reducer, between those at which its search begins again:
            gradients lead to a dark joint from within 10 mm.
        restart_cost: parts of the least cost up to which a form's search begins again: that lowers
            a cost to a third at most (measured).
        restart_sizes: number of starting sizes from which these searches are followed roughly.
        restarts: number of these searches that are followed.
        preceded: forms before which a reducer is tried: a fitting of another bore may be taken for
            another one.
        usual_stand: squared standard deviations of a camera's pose in straight pipe from which on
            all is searched again from the pipe's axis.
        dim_distances: (13,) bores, at which fittings that a lamp lights dimly have a search of
            their own: the coarse looks pass over the few pixels at the middle of the picture.
        dim_turns: number of directions of that search.
        dim_starts: starting sizes from which on a form has no such search.
        end_offsets: (41,) m, positions of an end that are compared beside the fitted one: gradients
            do not see its edge.
        angle_offsets: (19,) rad, angles of a bend that are compared beside the fitted one.
        usual_bend: rad, the angle that most elbows have.
        usual_bend_std: rad, its spread.
        beyond_rough: factor of the residual from which on a pixel's cost is bounded, where its ray
            leaves the fitting of a form by another port: more fittings may follow there.
        beyond_bias: cost that makes the mean of such pixels by noise alone that of the others.
        exit_error: standard deviations by which a pixel may be nearer than the port.
        horizon: bores, beyond which a fitting is not reported.
        min_valid: part of the pixels that have to be valid.
        error_scale: factor of the errors that the normal equations give, as measured: edges that
            fall between pixels have no gradient.
        lamp_alike: pixels that count as one by a lamp: patches of dirt cover several.
        misfit_cost: mean cost of a pixel from which on no form explains the picture, of all and
            of those that show no more than the form: another fitting behind it is not its fault.
        min_own: smallest share of pixels that show no more than the form.
        misfit_confidence: most probability of a form in such a picture.
        confidence: probability from which on a detection is unambiguous.
        pixel_steps: pixels between those that are compared, near the picture's axis and outside,
            of a rough comparison and of a close one: what lies ahead is small and at the middle.
        inner_part: part of half the field of view that counts as near the axis.
        border_part: part of half the field of view from which on a picture shows straight wall
            alone, which tells how the camera stands.
        pose_loss: residual, in standard deviations, from which on a pixel hardly counts, in the
            search for the camera's pose in the pipe, which begins on its axis: the less is known,
            the farther off a pixel may be.
        start_loss: the same, of the starts of a form.
        compared_loss: the same, of rows that differ by a step of a grid.
        search_loss: the same, of rows that follow gradients.
        last_loss: the same, at the end.
        last_steps: steps of the search at the end.
        chain_steps: steps of the search for a reducer with another fitting behind it: they have
            more sizes than one has.
        edge_reach: m along the pipe and rad about it, of a rough comparison and of a close one:
            differences by a lamp, wide enough to move the edges of shadows by a pixel.
        camera_std: (6,) m and rad, prior standard deviations of the camera's six numbers; distance
            and direction are unknown.
        bend_std: (6,) the same of a camera that looks out of a bend: its angle on the map is off by
            some degrees until the robot has passed it.
        port_std: m, standard deviation of the distance of a known port.
        gain_std: prior standard deviation of the gain of a whole picture, its exposure.
        gain_range: bounds of that gain: from, to.
        joint_range: m, distances at which a joint is looked for: from, to, step.
        joint_cost: cost that a joint must spare to be followed.
        joints: most joints that are followed.
        fixed_weight: weight of a number that is not sought, which keeps it where it is.
        nudge: (6,) m and rad, steps of the differences that the Jacobian is made of.
        max_step: (6,) m and rad, longest step of the search.
        max_size_step: the same of a size, in its steps.
        max_distance: m, bound of the distance of a port plane.
        size_grain: parts of its step to which a size is rounded, so that walls are reused.
        kept_walls: most walls that are kept for reuse.
        kept_cameras: most cameras of which what their rays have met is kept for reuse: a step of
            the search begins where an earlier one has ended.
        dampings: Marquardt's factors, all tried in each step.
    """

    behind: float = 0.9
    beyond: float = 1.6
    # Library
    scale_values: int = 4000
    ring_rays: int = 16
    rings: Array = field(
        default_factory=lambda: np.array(
            [0.05, 0.08, 0.11, 0.14, 0.17, 0.21, 0.25, 0.3, 0.36, 0.43, 0.52, 0.63, 0.76, 0.88]
        )
    )
    library_distances: Array = field(default_factory=lambda: np.arange(-0.6, 3.8, 0.1875))
    exposed_part: float = 0.9
    exposed_rays: int = 150
    library_blur: float = 3.0
    library_cap: float = 9.0
    # Search
    starts: int = 3
    distinct_distance: float = 0.4
    distinct_turn: float = 0.8
    joint_distance: float = 0.12
    excluded_cost: float = 25.0
    excluded_together: int = 32
    followed: tuple[int, int, int] = (14, 7, 3)
    follow_cost: tuple[float, float, float] = (400.0, 200.0, 100.0)
    follow_forms: tuple[int, int, int] = (5, 4, 2)
    rough_turns: Array = field(default_factory=lambda: _both_ways(8, 18, 30, 45, 65))
    fine_turns: Array = field(default_factory=lambda: _both_ways(2.5, 5, 8))
    few_starts: int = 3
    restart_offsets: Array = field(default_factory=lambda: _around(0.06, 0.012))
    restart_length: float = 0.375
    restart_cost: float = 4.0
    restart_sizes: int = 10
    restarts: int = 3
    preceded: int = 2
    usual_stand: float = 3.0
    dim_distances: Array = field(default_factory=lambda: np.arange(0.5, 2.35, 0.15))
    dim_turns: int = 16
    dim_starts: int = 9
    end_offsets: Array = field(default_factory=lambda: _around(0.04, 0.002))
    angle_offsets: Array = field(default_factory=lambda: _around(0.45, 0.05))
    usual_bend: float = np.pi / 2
    usual_bend_std: float = 0.05
    # Decision
    beyond_rough: float = 0.5
    beyond_bias: float = 0.23
    exit_error: float = 3.0
    horizon: float = 3.5
    min_valid: float = 0.2
    error_scale: float = 3.0
    lamp_alike: float = 2.0
    misfit_cost: float = 1.7
    min_own: float = 0.2
    misfit_confidence: float = 0.5
    confidence: float = 0.95
    # Fit
    pixel_steps: tuple[tuple[int, int], tuple[int, int]] = ((2, 4), (1, 3))
    inner_part: float = 0.56
    border_part: float = 0.75
    pose_loss: float = 12.0
    start_loss: float = 8.0
    compared_loss: float = 6.0
    search_loss: float = 5.0
    last_loss: float = 4.0
    last_steps: int = 3
    chain_steps: int = 4
    edge_reach: tuple[tuple[float, float], tuple[float, float]] = ((0.004, 0.09), (0.002, 0.05))
    camera_std: Array = field(default_factory=lambda: numbers(0.004, 0.03, FREE, FREE))
    bend_std: Array = field(default_factory=lambda: numbers(0.008, 0.1, FREE, FREE))
    port_std: float = 0.01
    gain_std: float = 0.02
    gain_range: tuple[float, float] = (0.8, 1.25)
    joint_range: tuple[float, float, float] = (0.02, 0.6, 0.004)
    joint_cost: float = 15.0
    joints: int = 4
    fixed_weight: float = 1e12
    nudge: Array = field(default_factory=lambda: numbers(0.0005, 0.005, 0.001, 0.01))
    max_step: Array = field(default_factory=lambda: numbers(0.003, 0.03, 0.04, 0.3))
    max_size_step: int = 8
    max_distance: float = 0.85
    size_grain: int = 8
    kept_walls: int = 2000
    kept_cameras: int = 512
    dampings: tuple[float, ...] = (1e-3, 0.3, 5.0)


RECOGNISER = RecogniserSettings()
