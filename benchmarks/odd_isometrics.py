"""Damaged piping component files: every one is read, or refused with the line.

python benchmarks/odd_isometrics.py [--files 500] [--seed 1]

Damages a plant's file: numbers, words and lines lost, doubled, swapped or changed, bytes flipped.
Prints how many were read and refused, and every other ending; the exit status is 1 if there is one.
"""

from __future__ import annotations

import random
import re
import sys

from shape import Arguments

from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.pipes.importing.isometric import build_plant
from omnitrack_sim.pipes.importing.pcf import read_pcf

PLANT = """ISOGEN-FILES ISOGEN.FLS
UNITS-BORE INCH
UNITS-CO-ORDS MM
PIPELINE-REFERENCE P-1
    PIPING-SPEC CS150
PIPE
    END-POINT 0.0 0.0 0.0 4 PL
    END-POINT 1000.0 0.0 0.0 4 BW
ELBOW
    END-POINT 1000.0 0.0 0.0 4
    END-POINT 1152.0 152.0 0.0 4
    CENTRE-POINT 1152.0 0.0 0.0
    SKEY ELBW
    ANGLE 9000
TEE
    END-POINT 1152.0 152.0 0.0 4
    END-POINT 1152.0 362.0 0.0 4
    CENTRE-POINT 1152.0 257.0 0.0
    BRANCH1-POINT 1257.0 257.0 0.0 4
REDUCER-CONCENTRIC
    END-POINT 1257.0 257.0 0.0 4
    END-POINT 1359.0 257.0 0.0 3
    SKEY RCBW
PIPE
    END-POINT 1152.0 362.0 0.0 4
    END-POINT 1152.0 2362.0 0.0 4
WELDOLET
    CENTRE-POINT 1152.0 1362.0 0.0
    BRANCH1-POINT 1152.0 1362.0 95.0 2
    SKEY WTBW
VALVE
    END-POINT 1152.0 2362.0 0.0 4
    END-POINT 1152.0 2591.0 0.0 4
    SKEY VTBW
    STATUS CLOSED
PIPE
    END-POINT 1152.0 2591.0 0.0 4
    END-POINT 1152.0 3591.0 0.0 4
CAP
    END-POINT 1152.0 3591.0 0.0 4
"""
WORDS = ("nan", "1e999", "-", "", "MM", "INCH", "END-POINT", "ELBOW", "\x00", "9" * 400, "TEE", "ü")


def damaged(rng: random.Random) -> str:
    """Return the plant's file after one to three changes."""
    text = PLANT
    for _ in range(rng.randint(1, 3)):
        lines = text.splitlines()
        at = rng.randrange(len(lines))
        words = lines[at].split(" ")
        way = rng.randrange(8)
        if way == 0:
            del lines[at]
        elif way == 1:
            lines.insert(rng.randrange(len(lines)), lines[at])
        elif way == 2:
            words[rng.randrange(len(words))] = rng.choice(WORDS)
        elif way == 3:
            del words[rng.randrange(len(words))]
        elif way == 4:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
            words = lines[at].split(" ")
        elif way == 5:
            number = str(rng.choice((0, -1, 1e9, 90, 1152.5, 0.001)))
            words = re.sub(r"[-\d.]+", number, lines[at], count=rng.randint(1, 3)).split(" ")
        elif way == 6:
            lines = lines[:at] or lines
            words = None
        if way in (2, 3, 4, 5) and words is not None:
            lines[at] = " ".join(words)
        text = "\n".join(lines)
        if way == 7:
            raw = bytearray(text.encode())
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
            text = raw.decode(errors="replace")
    return text


def read(text: str) -> str:
    """Read a file; returns "read", "refused", or what else came of it."""
    try:
        build_plant("odd", *read_pcf(text, ""))
    except NetworkError as error:
        wheres = {fault.where.partition(" ")[0] for fault in error.faults}
        return "refused" if wheres <= {"line", "file"} else f"no line: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "read"


def endings(files: int, seed: int) -> dict[str, int]:
    """Return how often each ending came."""
    rng, counts = random.Random(seed), dict[str, int]()
    for _ in range(files):
        ending = read(damaged(rng))
        counts[ending] = counts.get(ending, 0) + 1
    return counts


def main() -> None:
    """Print the endings."""
    asked = Arguments(__doc__, trials=500, of="files", seed=1).read()
    counts = endings(asked.files, asked.seed)
    for ending, count in sorted(counts.items(), key=lambda item: -item[1]):
        print(f"{count} {ending}")
    sys.exit(bool(set(counts) - {"read", "refused"}))


if __name__ == "__main__":
    main()
