"""The tables of ``[sensing]``: what the robot knows of itself, and by what; cameras by name."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from omnitrack_sim.base.naming import named
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.senses.cameras import DepthCamera, DepthTable, HeadlightCamera, HeadlightTable
from omnitrack_sim.senses.optics import Camera


class EncoderTable(Table):
    """``[sensing.encoders]``: of belts, wheels and rolls, on the motors' shafts.

    The counts are those of a Pololu magnetic encoder (12 a turn) behind a gear of 986.41.
    """

    counts: Annotated[int, Field(ge=1, le=10**7), Unit("1")] = 11837
    """Counts of one turn of a motor's output shaft."""
    radius_error: Annotated[float, Field(ge=0, le=0.2), Unit("1")] = 0.003
    """Standard deviation of a belt's own error of its travel, as a part of it: worn or stretched
    lugs; assumed."""


class ArmTable(Table):
    """``[sensing.arms]``: travel of the arms on their shafts, by a linear Hall sensor each.

    All figures are assumed.
    """

    noise: Annotated[float, Field(ge=0, le=0.05), Unit("m")] = 0.0002
    """Standard deviation of a reading."""
    bias: Annotated[float, Field(ge=0, le=0.05), Unit("m")] = 0.0002
    """Standard deviation of an arm's own constant error."""
    resolution: Annotated[float, Field(gt=0, le=0.05), Unit("m")] = 0.00005
    """Step of the readings."""


class CurrentTable(Table):
    """``[sensing.current]``: torque of the motors by their current. All figures are assumed."""

    noise: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.02
    """Standard deviation of a reading, as a part of the torque limit."""
    bias: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.01
    """Standard deviation of a motor's own constant error, as a part of the torque limit."""


class ImuTable(Table):
    """``[sensing.imu]``: rate gyro and accelerometer at the robot's centre.

    Noise, bias and error of scale are those of the data sheet of an ICM-42688-P, the biases after a
    calibration at rest.
    """

    gyro_noise_deg: Annotated[NotNegative, Unit("deg/s/sqrt(Hz)")] = 0.0028
    """Density of the gyro's noise."""
    gyro_bias_deg: Annotated[NotNegative, Unit("deg/s")] = 0.05
    """Standard deviation of its bias at the start."""
    gyro_walk_deg: Annotated[NotNegative, Unit("deg/s/sqrt(s)")] = 0.002
    """By which the bias wanders; assumed."""
    gyro_scale: Annotated[float, Field(ge=0, le=0.2), Unit("1")] = 0.002
    """Standard deviation of its error of scale."""
    force_noise: Annotated[NotNegative, Unit("m/s²/sqrt(Hz)")] = 0.0007
    """Density of the accelerometer's noise."""
    force_bias: Annotated[NotNegative, Unit("m/s²")] = 0.05
    """Standard deviation of its bias."""


class BeginTable(Table):
    """``[sensing.start]``: what the robot knows of its place as it begins."""

    distance_std: Annotated[float, Field(ge=0, le=1), Unit("m")] = 0.01
    """Standard deviation of the assumed distance along its pipe."""
    theta5_known: bool = False
    """The rotation about the pipe's axis is known."""


class FilterTable(Table):
    """``[sensing.filter]``: of the estimate of the robot's pose, see docs/how-to/autonomy.md."""

    # Dry belts slip by less than 1 % in straights; in turns by a tenth and more.
    slip_std: Annotated[float, Field(ge=1e-4, le=1), Unit("1")] = 0.01
    """Standard deviation of the belts' slip in straight pipe, as a part of their travel."""
    slip_turning: Annotated[float, Field(ge=1e-4, le=3), Unit("1")] = 0.15
    """The same in a turn as sharp as the pipe's radius."""
    # A robot that hangs in a branch runs its belts on the spot: they ask for a turn, and the gyro
    # says that there is none.
    slip_noticed: Annotated[float, Field(ge=0, le=3), Unit("1")] = 0.5
    """The same where the belts predict a turn that the gyro does not measure, by as much as
    their travel."""
    slip_time: Annotated[Part, Unit("s")] = 0.5
    """Time over which slip changes."""
    aside_std: Annotated[Part, Unit("m/sqrt(m)")] = 0.01
    """Lateral drift on a metre of travel."""
    # Round the corner of a branch the robot's centre moves aside as fast as it goes ahead.
    aside_turning: Annotated[Part, Unit("m/sqrt(m)")] = 0.1
    """The same in a turn as sharp as the pipe's radius."""
    turn_walk_deg: Annotated[NotNegative, Unit("deg/sqrt(s)")] = 0.3
    """Random walk of the direction, as robot and pipes differ from the map."""
    pixel_share: Annotated[float, Field(gt=0, le=1), Unit("1")] = 0.05
    """Fraction of a picture's pixels that counts as independent: their errors are correlated."""
    lamp_share: Annotated[float, Field(gt=0, le=1), Unit("1")] = 0.06
    """The same of a camera with a lamp: a patch of dirt covers several."""
    stride: Annotated[int, Field(ge=1, le=64), Unit("1")] = 3
    """Stride of the pixels that are compared with the map, in rows and columns."""
    arm_std: Annotated[Part, Unit("m")] = 0.002
    """Standard deviation of the position where a module touches the wall: its pitch is not
    measured."""
    force_std: Annotated[Part, Unit("m/s²")] = 1.5
    """Standard deviation of gravity in one reading of 0.1 s, with bias and the robot's
    accelerations."""
    misfit: Annotated[Part, Unit("1")] = 3.0
    """Median of the pixels' errors, in standard deviations, beyond which the picture does not
    fit the map."""
    misfit_time: Annotated[Part, Unit("s")] = 2.0
    """Time of such pictures after which the robot is lost."""
    sure_deg: Annotated[float, Field(gt=0, le=180)] = 4.0
    """Standard deviation of theta5 above which the robot does not enter a fitting that bends
    or branches."""


class SearchTable(Table):
    """``[sensing.search]``: recovery of a robot that does not know where it is.

    Lengths are for D = 160 mm and grow with the robot's bore.
    """

    tries: Annotated[int, Field(ge=1, le=1000), Unit("1")] = 4
    """Rounds of standing, stepping back and rolling after which it gives up (`lost`)."""
    look: Annotated[Part, Unit("s")] = 1.5
    """Time that it stands and looks, before and after each step."""
    step: Annotated[Part, Unit("m")] = 0.064
    """Way by which it steps back in the second half of its rounds."""
    roll_deg: Annotated[float, Field(ge=0, le=360)] = 40.0
    """By which it rolls its modules in each round, to see its pipe from another side."""


class SensingTable(Table):
    """``[sensing]``."""

    kind: Literal["truth", "onboard"] = "truth"
    """"truth": controllers receive the exact pose; "onboard": the estimate from onboard
    sensors."""
    camera: str = "depth"
    """"depth" measures distances, "headlight" brightness beside one lamp; `module:Class` names a
    camera of your own."""
    both_ends: bool = True
    """Cameras at both ends in turn, or only at the leading end. The rear one sees the fitting
    just passed."""
    encoders: EncoderTable = EncoderTable()
    arms: ArmTable = ArmTable()
    current: CurrentTable = CurrentTable()
    imu: ImuTable = ImuTable()
    depth: DepthTable = DepthTable()
    headlight: HeadlightTable = HeadlightTable()
    camera_parameters: dict[str, Any] = Field(default_factory=dict)
    """The table of a camera of your own."""
    start: BeginTable = BeginTable()
    filter: FilterTable = FilterTable()
    search: SearchTable = SearchTable()


CAMERAS: dict[str, Any] = {"depth": DepthCamera, "headlight": HeadlightCamera}
"""Shipped cameras by the name that ``sensing.camera`` gives."""


def camera_of(table: SensingTable) -> Camera:
    """The camera that ``sensing.camera`` names, made from its table.

    Raises:
        InputError: there is no such camera.
    """
    camera = named(table.camera, "sensing.camera", CAMERAS)
    if table.camera in CAMERAS:
        return camera(getattr(table, table.camera))
    return camera(camera.Table(**table.camera_parameters))
