"""The site: it builds without a warning, holds every name and effect, and needs no network."""

import importlib
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import pytest
from PIL import Image

import qlvbayes

ROOT = Path(__file__).parents[2]
BUILDING = ROOT / "docs" / "building"
PAGES = sorted((ROOT / "docs").glob("*.md"))
TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")


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
    command = (
        "import sys; from pathlib import Path; from stage import build; "
        "sys.exit(build(*map(Path, sys.argv[1:])))"
    )
    line = [sys.executable, "-c", command, folder / "pages", folder / "site"]
    done = subprocess.run(line, cwd=BUILDING, capture_output=True, text=True, check=False)
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


@pytest.mark.integration
def test_every_public_name_stands_on_one_page_of_the_api(site, building):
    pages = {page.name: read(page).ids for page in (site / "api").glob("*.html")}
    for public in building("public").public_names():
        assert [name for name, ids in pages.items() if public.path in ids], public.name


def test_what_the_code_makes_stands_in_the_pages(building):
    blocks = building("blocks")
    kinds = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        kinds |= {match[2] for match in blocks._BLOCK.finditer(text)}
        assert text.count("<!-- generated: ") == len(blocks._BLOCK.findall(text)), page.name
        assert blocks.refreshed(text) == text, f"{page.name}: make docs writes it anew"
        assert list(blocks.wrong_values(text)) == [], page.name
    assert kinds == set(blocks.KINDS)


def test_a_file_of_results_has_each_key_in_its_table(building):
    kind = qlvbayes.DiagnosisResult
    rows = list(building("records").record(kind))
    keys = [key.strip("`") for key, _, _ in rows]
    assert len(keys) == len(set(keys))
    known = {field.encode_name for field in msgspec.structs.fields(kind)}
    assert {key for key in keys if "." not in key} == known
    assert "ranking[].half_of_evidence.block_means" in keys
    assert ("`outside`", "number", "Probability that something unmodelled is there") in rows


def anchors(text):
    """Return the anchors of a page's headings, as a forge makes them."""
    plain = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    heads = re.findall(r"^#+ (.+)$", plain, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def test_links_lead_to_files_of_the_repository():
    links = 0
    for page in (*PAGES, *(ROOT / name for name in TOP), ROOT / "benchmarks" / "results.md"):
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\((?!https?:|mailto:)([^)\s]+)\)", text):
            path, _, anchor = target.partition("#")
            file = (page.parent / path).resolve() if path else page
            assert file.exists(), (page.name, target)
            assert not anchor or anchor in anchors(file.read_text("utf-8")), (page.name, target)
            links += 1
    assert links > 100


def test_pages_are_few_and_each_is_reached_from_the_readme():
    assert len(PAGES) <= 20
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    contents = (ROOT / "docs" / "contents.txt").read_text(encoding="utf-8").split("\n")
    for page in PAGES:
        assert f"(docs/{page.name})" in readme, page.name
        assert page.stem in contents, page.name
        assert "{{" not in page.read_text(encoding="utf-8")


def test_pictures_are_small_and_each_stands_on_a_page():
    pictures = list((ROOT / "docs" / "pictures").iterdir())
    files = (*PAGES, ROOT / "README.md")
    shown = " ".join(page.read_text(encoding="utf-8") for page in files)
    assert pictures
    for picture in pictures:
        assert f"pictures/{picture.name})" in shown, picture.name
        with Image.open(picture) as opened:
            assert opened.width <= 1200, picture.name
    assert sum(picture.stat().st_size for picture in pictures) < 1.5e6


@pytest.mark.integration
def test_every_notebook_is_a_tutorial_with_its_pictures(site):
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        page = site / "tutorials" / f"{path.stem}.html"
        assert page.exists()
        assert path.read_text(encoding="utf-8").count('"image/png"') <= len(
            [source for source in read(page).loads if source.endswith(".png")]
        )


@pytest.mark.integration
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


@pytest.mark.integration
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
