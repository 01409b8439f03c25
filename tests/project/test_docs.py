"""The site: it builds without a warning, holds every name and effect, and needs no network."""

import importlib
import inspect
import re
import sys
from dataclasses import is_dataclass
from html.parser import HTMLParser
from pathlib import Path

import pytest

import qlvbayes
from qlvbayes import effects, laws, plots, priors
from qlvbayes.effects.catalogue import EFFECTS

ROOT = Path(__file__).parents[2]
BUILDING = ROOT / "docs" / "building"
PUBLIC = [name for name in qlvbayes.__all__ if not inspect.ismodule(getattr(qlvbayes, name))]


@pytest.fixture(scope="module")
def building():
    """Import one of the modules that build the site."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BUILDING))
        yield importlib.import_module


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; a warning of Sphinx stops the build."""
    folder = tmp_path_factory.mktemp("docs")
    command = "import sys; from stage import build; sys.exit(build(*map(Path, sys.argv[1:])))"
    import subprocess

    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"from pathlib import Path; {command}",
            folder / "pages",
            folder / "site",
        ],
        cwd=BUILDING,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site"


class Elements(HTMLParser):
    """Ids of a page, and what it loads or links to."""

    def __init__(self):
        super().__init__()
        self.ids, self.loads, self.links = set(), [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids.add(attrs.get("id"))
        if tag == "a":
            self.links.append(attrs.get("href", ""))
        elif tag in ("script", "img", "iframe", "source"):
            self.loads.append(attrs.get("src", ""))
        elif tag == "link" and attrs.get("rel") in ("stylesheet", "icon", "preload"):
            self.loads.append(attrs.get("href", ""))


def read(page):
    elements = Elements()
    elements.feed(page.read_text(encoding="utf-8"))
    return elements


def test_every_public_name_has_a_docstring(building):
    names = building("public").public_names()
    found = {public.name for public in names}
    assert found >= {*PUBLIC, *effects.__all__, *laws.__all__, *priors.__all__}
    assert not [public.name for public in names if not public.summary]


def test_every_public_name_stands_on_one_page_of_the_api(site, building):
    pages = {page.name: read(page).ids for page in (site / "api").glob("*.html")}
    for public in building("public").public_names():
        assert [name for name, ids in pages.items() if public.path in ids], public.name


def test_every_figure_stands_on_the_page_of_figures(site, building):
    figures = building("public").figures()
    assert {public.name for public in figures} >= {
        n for n in plots.__all__ if n.startswith("plot_")
    }
    ids = read(site / "api" / "plots.html").ids
    assert not [public.name for public in figures if public.path not in ids or not public.summary]


def test_every_effect_stands_on_the_page_of_effects(site):
    text = (site / "effects.html").read_text(encoding="utf-8")
    ids = read(site / "effects.html").ids
    for kind in EFFECTS:
        assert kind.name.replace("_", "-") in ids or kind.name in ids, kind.name
        for constant in kind.units:
            assert f"{kind.name}.{constant}" in text


def test_every_command_stands_on_the_page_of_commands(site, building):
    text = (site / "commands.html").read_text(encoding="utf-8")
    commands = building("commands").commands()
    assert {"fit", "check", "diagnose", "study"} <= {command.name for command in commands}
    for command in commands:
        assert command.help
        assert f"qlvbayes {command.name}" in text


def test_the_computation_quotes_the_thresholds_of_the_code(site):
    from qlvbayes.diagnosis.settings import DiagnosisSettings

    text = re.sub(r"<[^>]+>", "", (site / "computation.html").read_text(encoding="utf-8"))
    settings: dict[str, object] = {}
    for name, value in vars(DiagnosisSettings()).items():
        several = (
            {f"{name}.{key}": own for key, own in vars(value).items()}
            if is_dataclass(value)
            else {}
        )
        settings |= several or {name: value}
    assert {"named", "breadth.beam", "discrepancy.rough", "cells.curves", "imitation.odds"} <= set(
        settings
    )
    for name, value in settings.items():
        assert re.search(rf"{name}\s+{re.escape(str(value))}", text), name


def test_an_unknown_name_stops_the_build(building):
    with pytest.raises(building("jinja2").UndefinedError):
        building("values").filled("{{ settings.no_such_threshold }}")
    with pytest.raises(AttributeError):
        building("values").filled('{{ constant("qlvbayes.laws.scales", "NO_SUCH") }}')


def test_every_notebook_is_a_tutorial_with_its_pictures(site):
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        page = site / "tutorials" / f"{path.stem}.html"
        assert page.exists()
        assert path.read_text(encoding="utf-8").count('"image/png"') <= len(
            [source for source in read(page).loads if source.endswith(".png")]
        )


def test_no_page_loads_anything_from_elsewhere_and_every_file_is_there(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        elements = read(page)
        for source in elements.loads:
            assert not source.startswith(("http:", "https:", "//")), (page.name, source)
            target = (page.parent / re.split(r"[?#]", source)[0]).resolve()
            assert source.startswith("data:") or target.exists(), (page.name, source)
    styles = [style.read_text(encoding="utf-8") for style in site.rglob("*.css")]
    assert not [style for style in styles if re.search(r"url\([\"']?(https?:)?//", style)]


def test_links_within_the_site_arrive(site):
    ids = {page: read(page).ids for page in site.rglob("*.html")}
    for page in ids:
        for link in read(page).links:
            if re.match(r"[a-z]+:", link) or not link:
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), (page.name, link)
            assert not anchor or anchor in ids[target], (page.name, link)


def test_links_of_the_readme_become_links_of_the_site(building):
    relinked = building("links").relinked
    assert relinked("[a](docs/validation.md#x)") == "[a](validation.md#x)"
    assert relinked("![p](docs/pictures/p.png)") == "![p](pictures/p.png)"
    assert relinked("[c](CONTRIBUTING.md)") == "[c](contributing.md)"
    assert relinked("[n](notebooks/01_a.ipynb)") == "[n](tutorials/01_a.md)"
    assert relinked("[d](data/pads.csv)") == "d (`data/pads.csv`)"
    assert relinked("[e](https://e.org) [f](#there)") == "[e](https://e.org) [f](#there)"
