"""Events as values: to plain data and back, and the sentences that people read."""

from __future__ import annotations

import dataclasses
import json

import pytest
from samples import sample_result

import omnitrack_sim as ot
from omnitrack_sim.record.events import BackedOff, Event, Note, Remark, event_of

SHIPPED = {name: kind for name, kind in Event.kinds.items() if kind.__module__ == Event.__module__}


def example(kind: type[Event]) -> Event:
    """An event of that kind with a value in every field."""
    texts = {"str": "what it says", "float": 12.5, "int": 7}
    fields = {f.name: texts[str(f.type)] for f in dataclasses.fields(kind) if f.name != "robot"}
    return kind(robot=3, **fields)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_kind_comes_back_from_plain_data(name: str) -> None:
    """Through JSON and back an event is what it was, with the same sentence."""
    event = example(SHIPPED[name])
    again = event_of(json.loads(json.dumps(event.to_table())))
    assert type(again) is SHIPPED[name]
    assert again == event
    assert str(again) == str(event)


@pytest.mark.parametrize("name", SHIPPED)
def test_plain_data_tells_kind_and_sentence_but_not_the_batch(name: str) -> None:
    """A table has the kind, the sentence and all fields; which robot of a batch it was is not
    told."""
    event = example(SHIPPED[name])
    table = event.to_table()
    assert (table["kind"], table["text"]) == (name, str(event))
    assert set(table) == {f.name for f in dataclasses.fields(event)} - {"robot"} | {"kind", "text"}


@pytest.mark.parametrize("name", sorted(set(SHIPPED) - {"Note"}))
def test_sentences_begin_with_the_time(name: str) -> None:
    """Every event but a note about the set-up is told with its time, and says what its fields
    say."""
    event = example(SHIPPED[name])
    sentence = str(event)
    assert sentence.startswith("12.50 s, ")
    says = any(str(f.type) == "str" for f in dataclasses.fields(event))
    assert ("what it says" in sentence) == says


def test_a_note_has_no_time() -> None:
    """What is told before a run begins has only its words."""
    assert str(Note(0, 0.0, "scaled")) == "scaled"


def test_an_unknown_kind_is_read_as_a_remark() -> None:
    """Of a kind whose module is not there the time and the words are left."""
    table = {"kind": "Sneezed", "time": 1.5, "loudness": 3.0, "text": "1.50 s, sneezed, loudly"}
    event = event_of(table)
    assert type(event) is Remark
    assert (event.time, event.text, str(event)) == (1.5, "sneezed, loudly", table["text"])
    table["text"] = "1.50 s, sneezed for 0.2 s, loudly"
    assert event_of(table).text == "sneezed for 0.2 s, loudly"


def test_events_of_two_robots_are_equal_where_they_say_the_same() -> None:
    """Which robot of a batch it was does not count: a run has the same events alone and among
    others."""
    assert BackedOff(0, 1.0, "tee_1", 0.5, 3.0) == BackedOff(7, 1.0, "tee_1", 0.5, 3.0)
    assert BackedOff(0, 1.0, "tee_1", 0.5, 3.0) != BackedOff(0, 1.0, "tee_2", 0.5, 3.0)


def test_events_of_a_users_own_are_saved_and_read_back(tmp_path) -> None:
    """A subclass is written with its fields and read back as what it was; without its module it is
    a remark with the same sentence."""

    @dataclasses.dataclass(frozen=True)
    class Whistled(Event):
        pitch: float

        @property
        def text(self) -> str:
            return f"whistled at {self.pitch:.0f} Hz"

    events = [Whistled(0, 2.0, 440.0)]
    folder = sample_result(events=events).save(tmp_path / "run")
    assert ot.load_result(folder).events == events
    del Event.kinds["Whistled"]
    (event,) = ot.load_result(folder).events
    assert type(event) is Remark
    assert str(event) == "2.00 s, whistled at 440 Hz"
