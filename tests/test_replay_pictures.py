"""What the robot sees, and where it takes itself to be, in replay pages."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest
from pages import needs_browser, opened
from PIL import Image
from runs import there_and_back

import omnitrack_sim as ot
from omnitrack_sim.show.film.overlay import levels, palette
from omnitrack_sim.show.replay.contents import PICTURE_PERIOD, TILES_ACROSS
from omnitrack_sim.show.replay.document import replay_data
from omnitrack_sim.show.run_playback import RunPlayback

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def result():
    """Two seconds of a mission of a robot that drives by what it sees."""
    changes = {
        "sensing.kind": "onboard",
        "record.pictures": True,
        "run.time_limit": 2.0,
    }
    return ot.run(ot.override(ot.load_scenario("missions/fig14"), changes))


def test_the_page_has_two_pictures_a_second_ahead(result):
    """Tiles of the last picture from the end that leads, in the colours of films."""
    table = replay_data(RunPlayback(result, coarse=False))["pictures"]
    assert np.diff(table["time"]).min() > PICTURE_PERIOD - 0.2
    assert len(table["time"]) == int(result.duration_s / PICTURE_PERIOD) + 1
    sheet = Image.open(io.BytesIO(base64.b64decode(table["png"])))
    pixels = np.asarray(sheet.convert("RGB"))
    for number, time in enumerate(table["time"]):
        index = result.pictures.index_at(time + 1e-6, 1)  # times of a page are rounded
        assert result.pictures.time[index] == pytest.approx(time)
        tile = pixels[48 * (number // TILES_ACROSS) :, 48 * (number % TILES_ACROSS) :][:48, :48]
        assert (tile == palette("m")[levels(result.pictures[index], "m")]).all()


def test_a_run_without_pictures_has_none_in_its_page():
    """Nor does its page speak of them."""
    data = replay_data(RunPlayback(ot.run(there_and_back()), coarse=False))
    assert data["pictures"] is None
    assert "position_estimate" not in json.dumps(data["panels"])


@needs_browser
def test_the_page_shows_the_picture_of_the_moment(browser, result, tmp_path):
    """The tile of the time, which changes with it; and on the map where the robot takes itself to
    be."""
    path = tmp_path / "page.html"
    ot.render_replay(result, path=path)
    assert path.stat().st_size < 4e6
    code = (
        "time => { replay.seek(time); replay.draw(); return replay.pictures.canvas.toDataURL(); }"
    )
    with opened(browser, path, hash="#t=1") as page:
        page.wait_for_function("replay.pictures.sheet.complete")
        for time in (0.2, 1.9):
            _, data = page.evaluate(code, time).split(",")
            image = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
            shown, width = np.asarray(image, int), image.width
            index = result.pictures.index_at(_start(page, time) + 1e-6, 1)
            picture = palette("m")[levels(result.pictures[index], "m")].astype(int)
            middles = ((np.arange(48) + 0.5) * width / 48).astype(int)
            assert np.abs(shown[np.ix_(middles, middles)] - picture).max() < 3
        row = int(np.argmin(np.abs(result.trajectory.time - 1.9)))
        mark = page.evaluate("replay.chart.mark")
        assert np.allclose(mark, result.trajectory["position_estimate"][row], atol=1e-4)
        assert page.locator("#pictures-box").is_visible()


def _start(page, time: float) -> float:
    """When the picture of a time was taken."""
    return max(start for start in page.evaluate("replay.data.pictures.time") if start <= time)
