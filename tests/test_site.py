"""The documentation as a site: it builds strictly, is whole, and needs no network."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel

import omnitrack_sim as ot
from omnitrack_sim.cli import app

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PICTURE = re.compile(r"!\[[^\]]+\]\(([^)]+)\)")
CHROMIUM = shutil.which("chromium")
EMPTY_PAGE = """# Page

It has $x^2$.
"""
NO_REFERENCE = """
def undocumented():
    return []

def write_reference(target):
    (target / "api.md").write_text("# Python names\\n")
"""
"""In place of the reference, whose names take Sphinx seconds."""
FAULTY_PAGE = """# Faulty

[gone](gone.md), [no such heading](page.md#nowhere), ![no picture](figures/none.png),
[a folder that is not there](../nowhere), `omnitrack run tee_turn --fats`.

```toml
a = = 1
```

```python
def broken(:
```

```sh
omnitrack fly tee_turn
python benchmarks/none.py
```

```
no language
```
"""


def built(root: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """Build the site of a checkout into a folder."""
    command = [sys.executable, "docs/site/build.py", str(target)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, built."""
    target = tmp_path_factory.mktemp("site") / "pages"
    told = built(ROOT, target)
    assert (told.returncode, told.stderr) == (0, "")
    return target


def test_every_page_and_public_name_is_in_the_site(site):
    """All pages of docs, and each public name with its signature and docstring, once."""
    for page in PAGES[1:]:
        assert page.stem == "README" or (site / f"{page.stem}.html").is_file(), page
    reference = "".join(page.read_text(encoding="utf-8") for page in site.glob("api-*.html"))
    for name in ot.__all__:
        assert reference.count(f'id="omnitrack_sim.{name}"') == 1, name
    assert reference.count(">Attributes") > 10


def test_every_command_and_option_is_in_the_site(site):
    """A section for each command, in it what its `--help` says of each option; and the navigation
    leads there."""
    page = (site / "commands.html").read_text(encoding="utf-8")
    for command in app.registered_commands:
        assert command.callback is not None
        assert f'<section id="omnitrack-{command.name or command.callback.__name__}">' in page
    run = page.partition('<section id="omnitrack-run">')[2].partition("</section>")[0]
    text = re.sub(r"<[^>]+>", "", run)
    for told in (
        "omnitrack run [OPTIONS] SCENARIO",
        "SCENARIO &lt;str&gt;",
        "--out DIR",
        "Folder of the results; one below out/ by default.",
        "--video / --no-video",
        "[default: video]",
    ):
        assert told in text, told
    assert 'href="commands.html"' in (site / "index.html").read_text(encoding="utf-8")


def test_equations_are_drawn_by_the_browser(site):
    """They are MathML in the page; no dollar signs are left, and no script draws them."""
    page = (site / "singularity.html").read_text(encoding="utf-8")
    assert page.count("<math") > 20
    assert "<msqrt>" in page
    assert "$" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"<script[^>]*(mathjax|katex)", page, re.IGNORECASE)


def test_links_to_folders_and_files_lead_into_the_site(site):
    """The start page shows the published models, the pages of sweeps the files."""
    start = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="files-models.html"' in start
    assert 'href="benchmarks.html"' in start
    sweeps = (site / "files-scenarios-sweeps.html").read_text(encoding="utf-8")
    assert "tee_monte_carlo.toml" in sweeps


def small_checkout(root: Path) -> None:
    """A checkout with two pages beside the start page."""
    for name in ("benchmarks", "docs/figures"):
        (root / name).mkdir(parents=True)
    shutil.copytree(ROOT / "docs" / "site", root / "docs" / "site")
    (root / "docs" / "site" / "reference.py").write_text(NO_REFERENCE, encoding="utf-8")
    shutil.copyfile(ROOT / "Makefile", root / "Makefile")
    texts = {
        "README.md": "# Start\n\n[contents](docs/README.md)\n",
        "CHANGELOG.md": "# Changelog\n\nNothing.\n",
        "benchmarks/README.md": "# Benchmarks\n\nNone.\n",
        "docs/page.md": EMPTY_PAGE,
        "docs/faulty.md": FAULTY_PAGE,
        "docs/README.md": (
            "# Documentation\n\n## Pages\n\n* [Start](../README.md)\n* [A page](page.md)\n"
            "* [Benchmarks](../benchmarks/README.md)\n* [Changelog](../CHANGELOG.md)\n"
        ),
    }
    for name, text in texts.items():
        (root / name).write_text(text, encoding="utf-8")


def test_every_fault_of_a_page_is_told_and_nothing_is_built(tmp_path):
    """Names, links, anchors, pictures, blocks, commands, options, scripts, and a page that the
    contents leave out; the site that was there stays."""
    small_checkout(tmp_path)
    old = tmp_path / "out" / "site"
    old.mkdir(parents=True)
    (old / "index.html").write_text("old", encoding="utf-8")
    told = built(tmp_path, old)
    assert told.returncode == 1
    for fault in (
        "docs/page.md: its heading is Page, its name in README.md A page",
        "docs/faulty.md: links to gone.md",
        "docs/faulty.md: links to figures/none.png",
        "docs/faulty.md: links to ../nowhere",
        "'nowhere'",
        "omnitrack run has no --fats",
        "faulty.md:6: a block that is no toml",
        "faulty.md:10: a block that is no python",
        "there is no command omnitrack fly",
        "faulty.md:19: a block of no language",
        "faulty.md: WARNING: document isn't included in any toctree",
    ):
        assert fault in told.stderr, fault
    assert (old / "index.html").read_text(encoding="utf-8") == "old"


@pytest.fixture
def tools(monkeypatch):
    """The modules that build the site can be imported."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))


def test_a_public_name_without_docs_is_a_fault(tools, monkeypatch):
    """So is a public member of a class; all that there are now have docs."""
    import reference

    assert reference.undocumented() == []

    class Bare:
        """A class."""

        def method(self): ...

    Bare.__module__ = "omnitrack_sim.bare"
    monkeypatch.setattr(ot, "__all__", ["bare", "Bare"])
    monkeypatch.setattr(ot, "bare", lambda: None, raising=False)
    monkeypatch.setattr(ot, "Bare", Bare, raising=False)
    assert reference.undocumented() == ["bare", "Bare.method"]


def test_what_a_page_loads_from_the_network_is_a_fault(tools, tmp_path):
    """Scripts, styles and pictures from elsewhere; a link to elsewhere is none."""
    import built as checks

    (tmp_path / "a.html").write_text(
        '<script src="https://cdn.example/x.js"></script><a href="https://example.org">x</a>'
        '<link rel="stylesheet" href="//fonts.example/y.css"><a href="b.html#no">b</a>'
        '<a href="c.html">c</a>',
        encoding="utf-8",
    )
    (tmp_path / "b.html").write_text('<p id="yes"></p><a href="a.html">a</a>', encoding="utf-8")
    (tmp_path / "style.css").write_text("@import 'https://x.example/z.css';", encoding="utf-8")
    assert checks.faults_of_site(tmp_path) == [
        "a.html: loads https://cdn.example/x.js from the network",
        "a.html: loads //fonts.example/y.css from the network",
        "a.html: links to b.html#no, which has no such anchor",
        "a.html: links to c.html, which is not there",
        "style.css: loads https://x.example/z.css",
    ]


def test_every_picture_is_used_and_every_page_of_pictures_names_a_command():
    """No picture of docs/figures is left over; a page that shows some says what draws them."""
    used = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        shown = PICTURE.findall(text)
        used |= {(page.parent / target).resolve() for target in shown}
        names_one = re.search(r"(`|^)(omnitrack|python benchmarks/|make) ?\w+", text, re.MULTILINE)
        assert not shown or names_one, page.name
    assert set((ROOT / "docs" / "figures").iterdir()) <= used


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_search_works_from_the_disk_and_nothing_is_asked_of_the_network(site):
    """Results with excerpts, on a page opened by file://; no error on the console, on no page."""
    from playwright.sync_api import sync_playwright

    errors, requests = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("console", lambda told: errors.append(told.text) if told.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto((site / "index.html").as_uri())
        page.keyboard.press("Control+K")
        page.keyboard.type("normal_force")
        page.keyboard.press("Enter")
        page.wait_for_selector("#search-results ul.search li p.context .highlighted")
        found = page.locator("#search-results ul.search li a").all_inner_texts()
        assert "Channels" in found
        page.locator("#search-results ul.search li a", has_text="Channels").first.click()
        page.wait_for_selector("h1")
        for name in ("kinematics.html", "api-sim.html"):
            page.goto((site / name).as_uri())
            page.set_viewport_size({"width": 390, "height": 800})
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
        browser.close()
    assert errors == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []


FOUND_FIRST = {
    "tee": {"Tee turns"},
    "film": {"Films"},
    "sweep": {"Sweeps"},
    "motion singularity": {"Motion singularity"},
    "retry": {"Tee turns", "Design study"},
    "preload": {"Tee turns", "Design study"},
}
"""Queries, and the pages about them, one of which or of whose sections comes first; the last two
are in no title of a page."""


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_that_is_about_it_is_found_first(site):
    """Words in titles come before words in headings and text; parts of words come last."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()

        def titles(query: str) -> list[str]:
            page.goto(f"{(site / 'search.html').as_uri()}?q={query}")
            page.wait_for_function(
                "/finished/.test(document.querySelector('.search-summary')?.innerText)"
            )
            return page.locator("#search-results ul.search > li > a").all_inner_texts()

        for query, about in FOUND_FIRST.items():
            assert titles(query)[0].partition(" > ")[0] in about, query
        found = titles("tee")
        browser.close()
    assert found.index("omnitrack_sim.Tee") < found.index("Changelog")
    assert found.index("Changelog") < found.index("omnitrack_sim.Drive.steers")


def test_tables_of_keys_are_made_from_the_models(site, tools):
    """The built pages have each key of the tables that their sources only mark."""
    import tables

    html = "".join(page.read_text(encoding="utf-8") for page in site.glob("*.html"))
    assert "<em>Table: " not in html
    for model in tables.MODELS.values():
        for key, info in model.model_fields.items():
            table = isinstance(info.get_default(call_default_factory=True), BaseModel)
            assert table or f">{key}</span>" in html, key
