"""diagnose, study and effects as a user calls them, on the bundled hidden case."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.endtoend import call, read_json

from qlvbayes import read_study
from qlvbayes.cli.settings import StudySettings
from qlvbayes.diagnosis.diagnose import diagnose
from qlvbayes.diagnosis.result import Base, DiagnosisResult
from qlvbayes.effects import check_effect
from qlvbayes.effects.catalogue import EFFECTS, find
from qlvbayes.fitting.relaxation import RelaxationReport
from qlvbayes.fitting.residuals import CheckResult, Curves
from qlvbayes.fitting.results import RunLog
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.model.choices import Choices
from qlvbayes.motion.experiment import prepare
from qlvbayes.pipeline.many import Work
from qlvbayes.pipeline.run import on_laws
from qlvbayes.pipeline.source import Source
from qlvbayes.pipeline.steps import CheckStep, DiagnoseStep, FitStep, is_finished
from qlvbayes.report.firstlook import FirstLook
from qlvbayes.use.prescribed.hypotheses import Hypotheses

ROOT = Path(__file__).parents[2]
HIDDEN = ROOT / "data" / "hidden.csv"
KINDS = {
    "summary": FitSummary, "check": CheckResult, "diagnosis": DiagnosisResult, "curves": Curves,
    "run": RunLog, "hypotheses": Hypotheses, "look": FirstLook, "relaxation": RelaxationReport,
}  # fmt: skip


@pytest.fixture(scope="module")
def hidden():
    (only,) = read_json(ROOT / "data" / "hidden.answer.json")["effects"]
    return only


@pytest.fixture(scope="module")
def own_effects(tmp_path_factory):
    """The worked example of docs/own.md, as a file."""
    text = (ROOT / "docs" / "own.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    path = tmp_path_factory.mktemp("own") / "my_effects.py"
    path.write_text(next(block for block in blocks if "class QuadraticDrag" in block))
    return path


def test_the_case_is_solved_and_refitted_with_the_named_effect(study, hidden):
    (folder, out), name = study, hidden["effect"]
    found, after = (read_json(folder / f"{x}.json") for x in ("diagnosis", "summary"))
    assert (found["verdict"], found["effects"]) == ("missing_effect", [name])
    for constant, value in hidden["parameters"].items():
        estimate = found["ranking"][0]["parameters"][constant]
        assert abs(estimate["mean"] - value) < 4.0 * estimate["sd"]
        assert f"{name}.{constant}" in after["parameters"]
    assert after["effects"] == read_json(folder / "check.json")["effects"] == [name]
    assert read_json(folder / "plain" / "summary.json")["effects"] == []
    assert f"pad C: missing effect: {name}" in out


def test_every_file_is_read_back_and_written_again_byte_for_byte(study):
    out = study[0].parent
    files = [file for file in sorted(out.rglob("*.json")) if ".finished" not in file.parts]
    assert {file.stem for file in files} == set(KINDS)
    for file in files:
        found = KINDS[file.stem].read(file)
        assert found.to_json().encode() == file.read_bytes()
        if file.stem != "hypotheses":  # holds arrays, which have no equality of their own
            assert KINDS[file.stem].from_json(found.to_json()) == found


def test_study_ends_with_the_report(study, case, hidden):
    folder, out = study
    report = folder.parent / "report.html"
    assert f"open {report} in a browser" in out
    text = report.read_text(encoding="utf-8")
    assert hidden["effect"] in text
    # priors actually used, from the fit; the command that repeats it, from the study
    assert "squeeze_film.h</th><td><code>loguniform(" in text
    run = read_json(folder.parent / "run.json")["runs"]["study"]
    assert run["command"].startswith(f"qlvbayes study {case[0]} -o ")
    assert run["command"].endswith("--max-steps 60")
    assert run["command"] in text


def test_another_law_takes_what_was_said_of_the_old_ones_constants_away():
    said = ("m=lognormal(-1,1)", "v[1]=lognormal(2,1)", "noise.white=lognormal(-5,1)")
    stay = ("c[0]=0.3", "friction.strength=0.1")
    mine = Choices(noise="white", effects="friction", priors=said, fixed=("b=1.2", *stay))
    base = Base("hertz", "prony:2", 0.99)
    moved = on_laws(mine, SimpleNamespace(verdict="adequate", base=base))
    assert (moved.elastic, moved.relaxing) == ("hertz", "prony:2")
    assert (moved.priors, moved.fixed) == (said[1:], stay)
    assert on_laws(mine, SimpleNamespace(verdict="unexplained", base=base)) == mine
    baseline = Base("exponential", "prony:2", 0.99)
    assert on_laws(mine, SimpleNamespace(verdict="adequate", base=baseline)) == mine


def test_diagnose_prints_json_for_machines(study, tmp_path, monkeypatch):
    """The output is the result and nothing else; the options reach the diagnosis."""
    found = DiagnosisResult.read(study[0] / "diagnosis.json")
    asked = {}

    def diagnosed(step, folder, pads, watcher):
        found.write(folder / "diagnosis.json")
        (folder / "diagnosis.txt").write_text("said\n")
        asked.update(step=step, folder=folder, pad=pads.pads[0].name)

    monkeypatch.setattr(DiagnoseStep, "run", diagnosed)
    words = ("--elastic", "hertz", "--tolerance", "2%", "--seed", "5", "--json")
    status, out, err = call("diagnose", HIDDEN, "-o", tmp_path / "out", *words)
    assert (status, err) == (0, "")
    assert json.loads(out) == [read_json(study[0] / "diagnosis.json")]
    assert (asked["folder"], asked["pad"]) == (tmp_path / "out" / "C", "C")
    assert (asked["step"].choices.elastic, asked["step"].seed) == ("hertz", 5)
    assert asked["step"].thresholds.tolerance == 0.02


def test_a_study_leaves_what_repeats_it_and_an_edited_figure_repeats_no_step(study, case):
    """Its settings give the same steps, which are finished: none computes with a figure."""
    out = study[0].parent
    given = StudySettings.from_options(out / "study.toml", ())
    assert (given["files"], given["seed"], given["max-steps"]) == ((case[0].resolve(),), 0, 60)
    assert {one.name for one in (out / ".finished").iterdir()} == {
        "plain-fit", "plain-check", "diagnose", "final",
    }  # fmt: skip
    for step in (FitStep, CheckStep, DiagnoseStep):
        assert not {"plots", "report", "cli", "app"} & set(step.code)
    choices = given.choices(read_study(case[0]))
    fit = FitStep(choices, settings=given.sampler(0), within="plain")
    alone = next(iter(Source.from_files(case[0])))
    work = Work((fit,), alone, out)
    assert is_finished(out, "plain-fit", "C", work.key(fit, study[0]), study[0])
    other = replace(fit, settings=given.sampler(1))
    assert not is_finished(out, "plain-fit", "C", work.key(other, study[0]), study[0])


def test_effects_lists_all_by_family():
    status, out, err = call("effects", "--json")
    assert (status, err) == (0, "")
    listed = json.loads(out)
    assert all(entry["law"] and entry["seen"] and entry["parameters"] for entry in listed)
    outside = [entry["outside"] for entry in listed]
    assert outside == sorted(outside)
    families = [entry["family"] for entry in listed]
    assert len(set(families) - {e["effect"] for e in listed if e["outside"]}) == len(EFFECTS)
    for place, entry in enumerate(listed):  # a form comes right after its family's others
        if entry["effect"] != entry["family"]:
            assert families[place - 1] == entry["family"]


def test_the_worked_example_keeps_the_rules(own_effects):
    check_effect(Choices(effects_file=str(own_effects)).candidates[-1])


@pytest.mark.slow
def test_the_worked_example_competes(own_effects):
    """Beside the effect that is hidden in the bundled case, in four of its tests."""
    own = Choices(effects_file=str(own_effects)).candidates[-1]
    (pad,) = read_study(HIDDEN).pads
    some = replace(pad, tests=pad.tests[::2] + pad.tests[-1:])
    found = diagnose(prepare(some), kinds=(own, find("squeeze_film"))).result
    ranked = {one.effect: one for one in found.ranking}
    assert ranked["quadratic_drag"].log_bayes_factor < ranked["squeeze_film"].log_bayes_factor
    assert found.effects == ("squeeze_film",)
