"""Bounds of the work that one file may ask for, each with its reason.

They are far beyond what the robot is for, pipes of some metres to some hundred metres driven in
minutes to hours, and catch a figure of the wrong size (a time step of 1e-9 s, 20 km of pipes)
before it fills the memory or runs for years. Whoever needs more splits the work into
several files.
"""

from __future__ import annotations

from omnitrack_sim.base.errors import Fault

MAX_STEPS = 100_000_000
"""Physics steps of a run up to its time limit: 55 simulated hours at 2 ms, some ten hours of
computing."""
MIN_STEP = 1e-6
"""Time step, s: a hundredth of the fastest contact of the smallest robot. The short run that
measures the slip without load takes 0.8 simulated seconds at this step too."""
MAX_SAMPLES = 5_000_000
"""Samples of all robots of one batch up to their time limits: 28 simulated hours of one robot at
20 ms. They stay in memory, 0.7 kB each, until the run is over, and twice that while it is written;
a run that gets through is over in a quarter of its time limit."""
MAX_LENGTH = 10_000.0
"""Length of all pipes, m. Parts are searched for overlaps along all of it: a second for a
kilometre in pieces of half a metre."""
MAX_PARTS = 1_000
"""Fittings of a route or network: checked and placed in some seconds, and a random network of so
many is grown in about ten."""
MAX_TOWN_LENGTH, MAX_TOWN_PARTS = 2_000_000.0, 100_000
"""Length of all pipes of a network file, m, and its fittings: a town of 400 km in 20,000 parts is
read, placed and searched for overlaps in ten seconds. What is simulated is at most ``MAX_LENGTH``
and ``MAX_PARTS`` of it (``Network.around``)."""
MAX_PIECES = 200_000
"""Boxes and capsules of all walls of primitives: a minute to build, and 1 GB. The exact collider
has one wall a fitting and no such bound."""
MAX_GOALS = 200
"""Goals of a mission: each has legs of its own, whose routes stay in memory."""
MAX_ORDERS = 5_000
"""Orders of a driver in a scenario: each is a key that was pressed, and takes 250 bytes of a file
that may have 2 MB."""
MAX_POLICY_BYTES = 16_000_000
"""Size of a policy file, packed and unpacked: two million weights, a hundred times what drives a
robot from sensor readings."""
MAX_LAYERS = 8
"""Layers of a policy's network: a few more than controllers are known to need."""
MAX_WIDTH = 2_048
"""Numbers between two of its layers: a layer of that width takes 30 ms a robot and decision."""
MAX_WEIGHT = 1e6
"""Size of a number in a policy's network: what it makes of entries then stays finite."""
MAX_TRIALS = 1_000_000
"""Trials of a sweep, or of a study's search, or of its check: each is a row of the table, which
stays in memory, and a run of a second or more."""
MAX_AXES = 50
"""Axes of a sweep."""
MAX_VALUES = 10_000_000
"""Values that a sweep sets, trials times axes: they are drawn before the first run."""
MAX_WORDS = 200
"""Texts and truth values on an axis of a sweep: each is tried in the scenario before the first
run."""
MAX_BATCH = 4_096
"""Trials of a sweep that run together in one batch."""
MAX_CANDIDATES = 1_000_000
"""Candidates of a study: each is a row of its history, which stays in memory."""
MAX_BASES = 50
"""Base scenarios of a study, of all its trials: the bounds of every variable are tried in each."""
MAX_NUMBER = 1e15
"""Size of a number on an axis of a sweep, and of a bound of a study: what is drawn between two of
them stays finite."""
MAX_FAULTS = 20
"""Faults of one kind that are looked for where each takes time to find, such as parts that run into
each other: a route that goes round in a circle a hundred times has thousands of them."""
MAX_COORDINATE = 1e5
"""Distance of a network's place from the origin, m: there a position is still exact to 1e-11 m."""

MAX_RUN_BYTES = 64_000_000
"""Size of ``scenario.json`` or ``result.json`` of a run: a long exploration tells of events and
legs in some megabytes."""
MAX_PAGE_NUMBERS = 100_000_000
"""Numbers of a replay page, seven a body and sample: a file of 300 MB, made in a minute or two; ten
hours of the paper's robot."""
MAX_PICTURE_CELLS = 100_000_000
"""Pixels of a picture that a model names: MuJoCo unpacks it."""
MAX_RECORDING_BYTES = 4_000_000_000
"""Size of a recording, packed and unpacked: an hour of a robot of 50 joints at 50 samples a second
has 1 GB."""
MAX_TABLE_BYTES = 20_000_000_000
"""Size of a file of samples, pictures or trials: pictures of ten hours."""
MAX_TEXT = 500_000_000
"""Bytes of all texts in a column of a table, each row's counted: reasons of a million trials."""
MAX_COLUMNS = 10_000
"""Columns of such a table."""
MAX_MODEL_TEXT = 10_000_000
"""Size of the text of a model file, MJCF or URDF: read and checked in half a second."""
MAX_MODEL_LEVELS = 400
"""Elements in each other: bodies of a chain, with what surrounds them. MuJoCo reads 500."""
MAX_MODEL_ELEMENTS = 100_000
"""Elements of a model, with all copies that ``replicate`` makes: compiled in some seconds."""
MAX_MODEL_CELLS = 100_000_000
"""Cells of a model's height fields, textures and made-up meshes: 400 MB."""
MAX_MODEL_COUNT = 1_000_000
"""Any other number of things that a model asks for, such as user data."""
MAX_MODEL_MEMORY = 4 * 1024**3
"""Bytes that a model asks for, for contacts and constraints of one robot."""
MAX_MODEL_FILES = 500_000_000
"""Bytes of all files that a model names: meshes and pictures."""


def too_long(length: float, where: str, limit: float = MAX_LENGTH) -> list[Fault]:
    """Return a fault if pipes are longer together than ``limit`` m."""
    if length <= limit:
        return []
    return [Fault(where, f"are {length:.6g} m long together; at most {limit:.6g} m")]
