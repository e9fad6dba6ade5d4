"""The page: claims, figures and frames in one HTML file that needs no network."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from omnitrack_sim.paper.claim import Claim, Verdict, tally


@dataclass(frozen=True)
class Picture:
    """A figure of the page: ``data`` is an SVG or PNG file."""

    name: str
    caption: str
    data: bytes
    format: str


@dataclass(frozen=True)
class Strip:
    """Frames of one run in order, (height, width, 3) uint8 each, with their times in s."""

    title: str
    frames: Sequence[NDArray]
    times: Sequence[float]


_CSS = """
:root { color-scheme: light dark; --ink: #22262b; --soft: #6a7079; --line: #dde1e6;
  --page: #ffffff; --card: #f6f7f9;
  --holds: #1b7a4d; --contradiction: #8a6100; --fails: #b5382f; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --soft: #9aa1ab; --line: #363b43;
  --page: #16181c;
  --card: #1f2228; --holds: #58c48f; --contradiction: #d9ae4a; --fails: #ec8077; } }
body { margin: 0 auto; max-width: 68rem; padding: 2.5rem 1.5rem 5rem; background: var(--page);
  color: var(--ink);
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; } h2 { margin: 3rem 0 .8rem; font-size: 1.3rem; }
p.lead { color: var(--soft); margin: 0 0 1.5rem; max-width: 48rem; }
.tally { display: flex; gap: 1rem; flex-wrap: wrap; } .tally div { background: var(--card);
  padding: .7rem 1.2rem;
  border-radius: .5rem; } .tally b { font-size: 1.5rem; display: block; line-height: 1.2; }
table { border-collapse: collapse; width: 100%; font-size: .92rem; } td, th { text-align: left;
  vertical-align: top;
  padding: .45rem .7rem .45rem 0; border-bottom: 1px solid var(--line); } th { color: var(--soft);
  font-weight: 500; }
.scroll { overflow-x: auto; }
article { border-top: 1px solid var(--line); padding: 1rem 0; } article h3 { margin: 0 0 .4rem;
  font-size: 1.02rem; }
dl { display: grid; grid-template-columns: 7.5rem 1fr; gap: .15rem 1rem; margin: 0;
  font-size: .94rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }
.chip { font-size: .8rem; font-weight: 600; padding: .1rem .55rem; border-radius: 1rem;
  border: 1px solid currentColor; white-space: nowrap;
  margin-right: .6rem; } .holds { color: var(--holds); } .fails { color: var(--fails); }
.contradiction { color: var(--contradiction); } .study { color: var(--soft); }
figure { margin: 1.5rem 0; } figure img { max-width: 100%; height: auto; background: #fff;
  border-radius: .4rem; } figcaption { color: var(--soft); font-size: .9rem; margin-top: .4rem; }
.strip { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: .6rem; }
.strip figure { margin: 0; } .strip img { width: 100%; } code { font-size: .9em; }
  a { color: inherit; }
"""


def page(
    claims: Sequence[Claim],
    pictures: Sequence[Picture],
    strips: Sequence[Strip],
    provenance: Mapping[str, Any],
    remarks: Sequence[str],
) -> str:
    """The whole page as HTML text.

    Args:
        claims: in the order of the page.
        pictures: figures.
        strips: frames of runs; none where nothing could be rendered.
        provenance: versions, commit, platform, runs.
        remarks: sentences below the title.
    """
    told = [*remarks, *(f"{c.difference}." for c in claims if c.difference)]
    head = "".join(f'<p class="lead">{_text(r)}</p>' for r in told)
    counts = "".join(f"<div><b>{n}</b>{verdict}</div>" for verdict, n in tally(claims).items())
    body = [
        "<h1>Omnidirectional Tractable Three Module Robot, reproduced</h1>",
        head,
        f'<div class="tally">{counts}</div>',
        "<h2>Verdicts</h2>",
        _table(claims),
        "<h2>Figures</h2>",
        *(_figure(p, [c for c in claims if p.name in c.figures]) for p in pictures),
        *(["<h2>Frames</h2>", *(_strip(s) for s in strips)] if strips else []),
        "<h2>Claims</h2>",
        *(_article(c) for c in claims),
        "<h2>Provenance</h2>",
        '<div class="scroll"><table>',
        *(f"<tr><th>{_text(k)}</th><td>{_text(v)}</td></tr>" for k, v in provenance.items()),
        "</table></div>",
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Three module robot, reproduced</title><style>{_CSS}</style></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _text(value: Any) -> str:
    return html.escape(str(value))


def _chip(claim: Claim) -> str:
    return f'<span class="chip {claim.verdict.name.lower()}">{claim.told}</span>'


def _table(claims: Sequence[Claim]) -> str:
    rows = "".join(
        f'<tr><td>{_chip(c)}</td><td><a href="#{_text(c.id)}">{_text(c.paper)}</a><br>'
        f"<small>{_text(c.source)}</small></td><td>{_text(c.measured)}{_small(c.reason)}</td></tr>"
        for c in claims
    )
    head = "<tr><th></th><th>paper</th><th>measured</th></tr>"
    return f'<div class="scroll"><table>{head}{rows}</table></div>'


def _small(text: str) -> str:
    return f"<br><small>{_text(text)}</small>" if text else ""


def _article(claim: Claim) -> str:
    asked = "asked" if claim.verdict is Verdict.STUDY else "true if"
    rows = (
        ("source", claim.source),
        ("paper", claim.paper),
        (asked, claim.statement),
        ("measured", claim.measured),
        ("how sure", claim.uncertainty),
        ("expected", claim.expected),
        ("how", claim.how),
        ("why", claim.reason),
        ("beside it", claim.note),
    )
    entries = "".join(f"<dt>{name}</dt><dd>{_text(value)}</dd>" for name, value in rows if value)
    name = _text(claim.id)
    return f'<article id="{name}"><h3>{_chip(claim)}{name}</h3><dl>{entries}</dl></article>'


def _figure(picture: Picture, claims: Sequence[Claim]) -> str:
    """A figure, with the verdicts of the claims that it shows."""
    kind = "svg+xml" if picture.format == "svg" else picture.format
    source = f"data:image/{kind};base64,{base64.b64encode(picture.data).decode()}"
    caption = _text(picture.caption)
    shown = "".join(f'<br>{_chip(c)}<a href="#{_text(c.id)}">{_text(c.id)}</a>' for c in claims)
    return (
        f'<figure><img src="{source}" alt="{caption}">'
        f"<figcaption>{caption}{shown}</figcaption></figure>"
    )


def _strip(strip: Strip) -> str:
    from omnitrack_sim.show.film.strip import label

    frames = "".join(
        f'<figure><img src="data:image/jpeg;base64,{_jpeg(frame)}" '
        f'alt="{_text(strip.title)} at {time:.1f} s">'
        f"<figcaption>{label(index)} {time:.1f} s</figcaption></figure>"
        for index, (frame, time) in enumerate(zip(strip.frames, strip.times, strict=True))
    )
    return f'<h3>{_text(strip.title)}</h3><div class="strip">{frames}</div>'


def _jpeg(frame: NDArray) -> str:
    import imageio.v3 as imageio

    data = imageio.imwrite("<bytes>", frame, plugin="pillow", extension=".jpg", quality=82)
    assert data is not None  # it is for files only
    return base64.b64encode(data).decode()
