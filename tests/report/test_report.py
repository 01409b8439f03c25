"""The report: what it says, in which order, and of results that are incomplete or hostile."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import arviz_base
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import written_results
from support.endtoend import Listener, call
from support.written_results import NOISE, curves, diagnosis, facts, summary, write

from qlvbayes import InputError, write_report
from qlvbayes.fitting.results import record_run
from qlvbayes.io.data import read_measurements
from qlvbayes.io.wording import number, percent_unbroken
from qlvbayes.laws.elastic.exponential import Exponential
from qlvbayes.laws.elastic.polynomial import HertzPower, Linear
from qlvbayes.model.choices import Choices
from qlvbayes.pipeline.derived import compare_pairs
from qlvbayes.report.collect import collect, runs_in
from qlvbayes.report.figures import chart_of
from qlvbayes.report.methods import methods_of
from qlvbayes.report.verdicts import verdict_box

HOSTILE = "<img src=x onerror=alert(1)>&\"'"


class Page(HTMLParser):
    """Elements with their attributes, and the text between them, of scripts apart."""

    def __init__(self, path):
        super().__init__()
        self.elements, self.text, self.scripts = [], "", []
        self._inside = ""
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = ""
        self.text += " " * (tag in ("p", "li", "td", "th", "dt", "dd", "small"))

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts.append(data)
        elif self._inside != "style":
            self.text += data

    def of(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]

    @property
    def words(self):
        return " ".join(self.text.split())


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return written_results.write_study(tmp_path_factory.mktemp("results"))


@pytest.fixture(scope="module")
def page(out):
    return Page(write_report(out))


def test_the_verdict_comes_first_with_errors_before_and_after_beside_the_noise(page, out):
    sections = [attrs["id"] for attrs in page.of("section")]
    assert sections == ["verdict", "constants", "compare", "fails", "effects", "use", "methods"]
    boxes = [attrs["class"] for attrs in page.of("article")]
    assert boxes == ["box missing_effect", "box adequate"]
    box = verdict_box(collect(out).pads[0])
    texts = [text.replace("\u00a0", " ") for _, _, text, _ in box["bars"]]
    assert texts == ["0.0480 N", "0.0103 N", "0.0100 N"]
    shares = [share for _, share, _, _ in box["bars"]]
    assert shares == pytest.approx([1.0, 0.0103 / 0.048, NOISE / 0.048])


def on_hertz(verdict, named=()):
    """A diagnosis that asks for another elastic law than was chosen."""
    found = diagnosis("B", verdict, named)
    hertz = found["base"] | {"elastic": "hertz"}
    last = found["steps"][-1] | {"base": {k: hertz[k] for k in ("elastic", "relaxation")}}
    return found | {"base": hertz, "steps": [found["steps"][0], last]}


@pytest.mark.parametrize(
    ("law", "verdict", "said"),
    [("exponential", "missing_effect", True), ("hertz", "missing_effect", False),
     ("exponential", "unexplained", False), ("of_my_own", "missing_effect", False)],
)  # fmt: skip
def test_a_fit_with_other_laws_than_the_tests_ask_for_is_warned_of(tmp_path, law, verdict, said):
    """Not where the verdict stands on none, nor where the law's file has gone."""
    write(tmp_path / "B" / "diagnosis.json", on_hertz(verdict, ("friction",)))
    write(tmp_path / "B" / "summary.json", summary("B", ("friction",)))
    chosen = {"law": law, "modes": 2, "effects": ["friction"]}
    facts(tmp_path / "B" / "posterior.nc", choices=json.dumps(chosen))
    warned = " ".join(verdict_box(collect(tmp_path).pads[0])["warnings"])
    again = "fit again with --elastic hertz --relaxation prony:2 --add friction."
    assert (again in warned) == said


def test_methods_and_commands_say_how_to_repeat_and_use_it(page, out):
    tail = page.words[page.words.index("How this was done") :]
    assert "qlvbayes study data/pads.csv -o results --seed 7" in tail
    assert "ab" * 32 in tail
    assert "lognormal(0.2953, 1.609)" in tail
    assert "/somewhere" not in tail
    assert f"qlvbayes export {out.name} --pad B --to c,fmu,json" in page.words


def test_every_figure_is_inside_nothing_outside_is_referred_to_and_the_page_repeats(out, page):
    pictures = page.of("img")
    drawn = 2 * len(written_results.FIGURES) + 1
    hidden = 3  # of the pad that lacks nothing
    assert drawn - hidden <= len(pictures) <= drawn
    assert all(len(attrs["alt"]) > 20 for attrs in pictures)
    assert all(attrs["src"].startswith("data:image/png;base64,") for attrs in pictures)
    assert len(page.of("figure")) == len(page.of("figcaption")) == len(pictures)
    text = write_report(out).read_text(encoding="utf-8")
    links = [a[k] for _, a in page.elements for k in ("src", "href", "data", "action") if k in a]
    assert all(link.startswith(("data:", "#")) for link in links)
    assert "url(" not in text
    assert "@import" not in text
    assert not page.of("iframe")
    anchors = {attrs["id"] for _, attrs in page.elements if "id" in attrs}
    assert {link[1:] for link in links if link.startswith("#")} <= anchors
    assert write_report(out).read_bytes() == write_report(str(out)).read_bytes()


@pytest.mark.parametrize(
    ("word", "law"), [("exponential", Exponential), ("linear", Linear), ("hertz", HertzPower)]
)
def test_the_elastic_law_is_written_with_its_own_constants(tmp_path, word, law):
    facts(tmp_path / "B" / "posterior.nc", choices=json.dumps({"law": word}))
    write(tmp_path / "B" / "summary.json", summary("B"))
    formula = methods_of(collect(tmp_path))["law"].partition(" = ")[2].partition(",")[0]
    assert set(re.findall(r"[a-z]", formula.replace("exp", ""))) == set(law.units)


def test_names_are_shown_as_they_are_and_never_obeyed(tmp_path):
    written_results.write_pad(tmp_path, "B")
    for place in (tmp_path / "B", tmp_path / "B" / "plain"):
        for name in ("summary", "check", "curves"):
            file = place / f"{name}.json"
            write(file, json.loads(file.read_text().replace('"B-fast"', json.dumps(HOSTILE))))
    write(tmp_path / "B" / "summary.json", summary(HOSTILE, ("viscous_drag",)))
    page = Page(write_report(tmp_path))
    assert HOSTILE in page.text
    assert "x" not in [attrs.get("src") for attrs in page.of("img")]
    data = [text for text in page.scripts if text.startswith("{")]
    assert len(data) == 1
    assert "<" not in data[0]
    assert json.loads(data[0])["tests"][1]["name"] == HOSTILE


def test_a_damaged_file_is_named_and_the_old_report_stays(tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match="no results in this folder; run qlvbayes study"):
            write_report(folder)
    write(tmp_path / "B" / "summary.json", summary("B"))
    before = write_report(tmp_path).read_bytes()
    (tmp_path / "B" / "check.json").write_text('{"schema": 1,')
    status, _, err = call("report", tmp_path)
    assert status == 2
    assert re.fullmatch(r"qlvbayes: .*check\.json: cannot be read .*; run .*\n", err)
    assert (tmp_path / "report.html").read_bytes() == before


def test_the_page_stays_small_and_names_the_figures_it_leaves_out(tmp_path):
    for pad in "ABCD":
        write(tmp_path / pad / "summary.json", summary(pad))
        written_results.picture(tmp_path / pad / "forces.png", (1100, 1100), noisy=True)
    path = write_report(tmp_path)
    assert path.stat().st_size < 5_000_000
    words = Page(path).words
    assert "Left out to keep this page small: D/forces.png" in words
    assert "Left out to keep this page small: A/forces.png" not in words


def test_curves_are_drawn_as_they_were_left_or_thinned_to_the_ends_of_phases(out, tmp_path):
    pad = collect(out).pads[0]
    chart = chart_of(pad)
    left = curves("B", ("viscous_drag",), NOISE)["tests"]
    for drawn, test in zip(chart["tests"], left, strict=True):
        assert (drawn["t"], drawn["observed"]) == (test["time_s"], test["observed_N"])
        assert (drawn["mean"], drawn["low"]) == (test["mean_N"], test["low_N"])
        missed = [a - b for a, b in zip(drawn["mean"], drawn["plain"], strict=True)]
        assert max(missed) == pytest.approx(3.7 * NOISE)
    assert chart["tests"][chart["first"]]["name"] == "B-fast"
    write(tmp_path / "B" / "summary.json", summary("B"))
    write(tmp_path / "B" / "curves.json", curves("B", samples=4000))
    test = chart_of(collect(tmp_path).pads[0])["tests"][0]
    left = curves("B", samples=4000)["tests"][0]["time_s"]
    assert 2000 < len(test["t"]) <= 3000
    for k in range(4):
        assert {left[4000 * k], left[4000 * k + 3999]} <= set(test["t"])


@given(st.floats(-1e12, 1e12), st.integers(2, 6), st.booleans())
def test_numbers_can_be_read_back(value, digits, zeros):
    text = number(value, digits, zeros=zeros).replace("−", "-")
    base, _, power = text.partition(" × 10")
    power = power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    read = float(f"{base}e{power or 0}")
    assert read == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))
    share = abs(value) / 1e12  # no probability is rounded to certainty
    if 0.0 < share < 1.0:
        assert percent_unbroken(share).split("\u00a0")[0] not in ("0", "100")


def test_a_diagnosis_alone_has_its_units_and_leads_to_the_study_as_it_was_typed(tmp_path):
    found = diagnosis("B")
    found["units"] = {"displacement": "1", "force": "kPa"}
    write(tmp_path / "B" / "diagnosis.json", found)
    typed = "qlvbayes diagnose my/x.csv --bonded -o r"
    run = written_results.stored("run", command=typed)
    write(tmp_path / "run.json", {"schema": 1, "runs": {"diagnose": run}})
    assert collect(tmp_path).pads[0].force_unit == "kPa"
    assert collect(tmp_path).pads[0].speed_unit == "1/s"
    assert "qlvbayes study my/x.csv --bonded -o r" in Page(write_report(tmp_path)).words


def test_a_run_is_noted_step_by_step_and_a_study_replaces_them(tmp_path):
    study = read_measurements(Path(__file__).parents[2] / "data" / "hidden.csv")
    for step in ("fit", "diagnose"):
        record_run(tmp_path, step, f"qlvbayes {step} x.csv", study, Choices(), 3)
    runs = runs_in(tmp_path)
    commands = {name: f"qlvbayes {name} x.csv" for name in ("fit", "diagnose")}
    assert {name: run.command for name, run in runs.items()} == commands
    assert runs["fit"].sha256 == study.sha256
    assert runs["fit"].versions["jax"]
    assert Choices.from_dict(runs["fit"].choices) == Choices()
    record_run(tmp_path, "study", "qlvbayes study x.csv", study, replace(Choices(), modes=3), 3)
    assert list(runs_in(tmp_path)) == ["study"]


def test_many_pads_are_not_all_compared_unasked(tmp_path):
    listener = Listener()
    pads = [SimpleNamespace(pad=name, fluid=None) for name in "ABCDE"]
    compare_pairs(tmp_path, pads, 0, listener)
    assert listener.notices[0].startswith("5 pads make 10 pairs")
    assert not list(tmp_path.iterdir())


def test_a_posterior_made_elsewhere_is_reported_from_its_draws(tmp_path):
    rng = np.random.default_rng(3)
    m = rng.normal(0.34, 0.01, (4, 500))
    c = np.stack([np.full_like(m, share) for share in (0.3, 0.6, 0.1)], axis=-1)
    v = np.stack([rng.normal(rate, 0.01 * rate, m.shape) for rate in (6.0, 0.1)], axis=-1)
    tree = arviz_base.from_dict({"posterior": {"m": m, "b": m + 0.8, "c": c, "v": v}})
    (tmp_path / "mine").mkdir()
    tree.to_netcdf(tmp_path / "mine" / "posterior.nc", engine="h5netcdf")
    pad = collect(tmp_path).pads[0]
    found = pad.final.summary
    assert (found["m"].unit, found["v[2]"].unit) == ("N/mm", "1/s")
    assert found["m"].median == pytest.approx(np.median(m))
    low, high = found["m"].hdi90
    assert np.mean((m >= low) & (m <= high)) == pytest.approx(0.9, abs=0.001)
    words = Page(write_report(tmp_path)).words
    assert "Pad mine: m = 0.340" in words
    assert f"qlvbayes check {tmp_path.name}" in words
