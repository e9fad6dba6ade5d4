"""From a study to its figure."""

from __future__ import annotations

import io

import numpy as np

from omnitrack_sim.show.plots.study import Scale, Tried, study_figure
from omnitrack_sim.show.plots.style import save_figure
from omnitrack_sim.trials.optimise.choice import front
from omnitrack_sim.trials.optimise.explore import Candidate, History, values_of
from omnitrack_sim.trials.optimise.history import unit_of_objective
from omnitrack_sim.trials.optimise.search import violations_of
from omnitrack_sim.trials.optimise.spec import Study


def draw_front(study: Study, history: History, checked: History | None, best: Candidate) -> bytes:
    """``front.png``, of the objectives that have a weight; of the others the limits alone count."""
    weighed = list(study.weighed)
    scales = [
        Scale(name, unit_of_objective(study, objective), objective.goal, objective.limit)
        for name, objective in ((study.columns[i], study.objectives[i]) for i in weighed)
    ]
    values = values_of(history)
    again = values_of(checked)[:, weighed] if checked else np.empty((0, len(scales)))
    places = [one.number for one, _ in checked or ()]
    feasible = violations_of(study, values) == 0
    on_front = front(study, history)
    tried = Tried(values[:, weighed], feasible, on_front, best.number, again, places)
    buffer = io.BytesIO()
    save_figure(study_figure(scales, tried), buffer, "png")
    return buffer.getvalue()
