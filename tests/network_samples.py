"""Parts of networks, and two networks, as plain data."""

from __future__ import annotations


def straight(name: str, length: float = 0.4, **sizes) -> dict:
    return {"kind": "straight", "name": name, "length": length, **sizes}


def tee(name: str) -> dict:
    return {"kind": "tee", "name": name}


def elbow(name: str, **sizes) -> dict:
    return {"kind": "elbow", "name": name, **sizes}


def reducer(name: str, end_diameter: float = 0.12, **sizes) -> dict:
    return {"kind": "reducer", "name": name, "length": 0.15, "end_diameter": end_diameter, **sizes}


def joint(a: str, b: str, turn_deg: float = 0.0) -> dict:
    return {"ports": [a, b], "turn_deg": turn_deg}


def forked(on: float = 0.3, off: float = 0.3) -> dict:
    """A straight into a tee, and one of a length, m, at each of its other ports, as plain data."""
    return {
        "fittings": [straight("foot", 0.3), tee("fork"), straight("on", on), straight("off", off)],
        "joints": [
            joint("foot.end", "fork.run_start"),
            joint("fork.run_end", "on.start"),
            joint("fork.branch", "off.start"),
        ],
    }


def branched(**changes) -> dict:
    """A riser, a tee, and a straight at each of its other ports, as plain data."""
    return {
        "fittings": [straight("a"), tee("t"), straight("b"), straight("c", 0.5)],
        "joints": [
            joint("a.end", "t.run_start"),
            joint("t.run_end", "b.start"),
            joint("t.branch", "c.end"),
        ],
        **changes,
    }


def narrowed(**changes) -> dict:
    """``branched`` with the branch led on through a reducer into a bore of 120 mm, as plain
    data."""
    data = branched()
    data["fittings"] += [reducer("r"), straight("d", 0.5, inner_diameter=0.12)]
    data["joints"] += [joint("c.start", "r.start"), joint("r.end", "d.start")]
    return data | changes
