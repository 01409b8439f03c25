"""Check that every result is a record, and that its file gives the same record back."""

import importlib
import json
import pkgutil
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.written_results import write_study

import qlvbayes
from qlvbayes import InputError
from qlvbayes.comparison.contrast import Comparison
from qlvbayes.diagnosis.nexttest.planning import NextTests
from qlvbayes.diagnosis.result import DiagnosisResult, Estimate
from qlvbayes.diagnosis.settings import DiagnosisSettings
from qlvbayes.fitting.ensemble import Settings as Sampler
from qlvbayes.fitting.relaxation import RelaxationReport
from qlvbayes.fitting.residuals import CheckResult, Curves
from qlvbayes.fitting.results import RunLog
from qlvbayes.fitting.summary import FitSummary
from qlvbayes.io.files import Result
from qlvbayes.io.units import PAD, STRAIN, UnitSystem
from qlvbayes.model.choices import Choices
from qlvbayes.priors import LogNormal
from qlvbayes.report.firstlook import FirstLook
from qlvbayes.report.methods import settings_rows
from qlvbayes.use.prescribed.hypotheses import Hypotheses

KINDS = {
    "summary": FitSummary,
    "check": CheckResult,
    "diagnosis": DiagnosisResult,
    "compare": Comparison,
    "curves": Curves,
    "run": RunLog,
}
EVERY = [*KINDS.values(), FirstLook, Hypotheses, NextTests, RelaxationReport]


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("results"))


@pytest.mark.parametrize("name", KINDS)
def test_a_file_and_its_record_are_each_made_of_the_other_or_a_newer_one_is_refused(out, name):
    files = sorted(out.rglob(f"{name}.json"))
    assert files
    for file in files:
        found = KINDS[name].read(file)
        given, kept = json.loads(file.read_text()), found.as_dict()
        assert {key: kept[key] for key in given} == given
    newer = json.dumps(given | {"schema": 99})
    with pytest.raises(InputError, match=r"newer version of qlvbayes \(schema 99, .*; update"):
        KINDS[name].from_json(newer, file=file)


AWKWARD = (0.0, -0.0, 1.0 / 3.0, 5e-324, -1.7976931348623157e308, 1e22, 0.1 + 0.2)
TEXTS = ("", "B", "c[0]", "\u00b5m \U0001f642", 'a "quoted", \\ line\n', "\x00")


def any_of(kind, rng):
    """Some value of a record's field, made of its annotation."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        least = parts[1].min_length
        return tuple(any_of(get_args(parts[0])[0], rng) for _ in range(least + rng.integers(3)))
    if origin is tuple:
        several = [parts[0]] * rng.integers(4) if parts[-1] is Ellipsis else parts
        return tuple(any_of(part, rng) for part in several)
    if origin is dict:
        return {rng.choice(TEXTS): any_of(parts[1], rng) for _ in range(rng.integers(3))}
    if origin is Literal:
        return parts[rng.integers(len(parts))]
    if origin in (Union, UnionType):
        return any_of(parts[rng.integers(len(parts))], rng)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        fields = msgspec.structs.fields(kind)
        return kind(**{field.name: any_of(field.type, rng) for field in fields})
    if kind in PLAIN:
        return PLAIN[kind](rng)
    if issubclass(kind, Enum):
        return list(kind)[rng.integers(len(kind))]
    return kind(**{name: any_of(part, rng) for name, part in get_type_hints(kind).items()})


PLAIN = {
    float: lambda rng: float(rng.choice([*AWKWARD, rng.normal(), rng.lognormal(0.0, 50.0)])),
    str: lambda rng: str(rng.choice(TEXTS)),
    int: lambda rng: int(rng.integers(-(2**53), 2**53)),
    bool: lambda rng: bool(rng.integers(2)),
    type(None): lambda rng: None,
    UnitSystem: lambda rng: (PAD, STRAIN)[rng.integers(2)],
    Sampler: lambda rng: Sampler(*map(int, rng.integers(1, 2**31, 5))),
    DiagnosisSettings: lambda rng: DiagnosisSettings(*rng.uniform(0.0, 0.5, 7)),
    Choices: lambda rng: Choices(
        elastic=str(rng.choice(["hertz", "spline"])), priors={"v[1]": LogNormal(rng.normal(), 0.1)}
    ),
    Any: lambda rng: (None, True, 0.5, "x", 3)[rng.integers(5)],
}


@pytest.mark.parametrize("kind", EVERY, ids=lambda kind: kind.__name__)
def test_every_record_comes_back_as_the_same_object(kind):
    rng = np.random.default_rng(0)
    for _ in range(8):
        found = any_of(kind, rng)
        text = found.to_json()
        again = kind.from_json(text)
        assert again == found
        assert again.to_json() == text
        assert json.loads(text)["schema"] == 1


def test_no_kind_of_file_is_forgotten():
    """Whatever is written as a result is among those that are read back here."""
    for module in pkgutil.walk_packages(qlvbayes.__path__, "qlvbayes."):
        importlib.import_module(module.name)
    assert set(Result.__subclasses__()) == set(EVERY)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(sorted(KINDS)), st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_that_was_cut_is_refused_in_one_line(out, name, share):
    file = next(out.rglob(f"{name}.json"))
    text = file.read_bytes().rstrip()
    with pytest.raises(InputError) as refused:
        KINDS[name].from_json(text[: int(share * len(text))], file=file)
    said = str(refused.value)
    assert said.startswith(f"{file}: cannot be read as results of qlvbayes (")
    assert said.endswith("; run the command again")
    assert "\n" not in said


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("check", {"noise_N": "small"}, r"Expected `float`, got `str` - at `\$\.noise_N`"),
        ("summary", {"converged": 1}, r"at `\$\.converged`"),
        ("diagnosis", {"steps": {}}, r"at `\$\.steps`"),
        ("diagnosis", {"steps": []}, r"length >= 1 - at `\$\.steps`"),
        ("compare", {"names": ["B"]}, r"at `\$\.names`"),
    ],
)
def test_a_wrong_type_is_told_by_its_place(out, name, change, said):
    content = json.loads(next(out.rglob(f"{name}.json")).read_text()) | change
    with pytest.raises(InputError, match=said):
        KINDS[name].from_json(json.dumps(content))


@pytest.mark.parametrize(
    "given", ["", "[]", "3", '{"pad": "B"}', '{"schema": "one"}', "\xff", "NaN"]
)
def test_what_is_no_result_is_refused(given):
    for kind in KINDS.values():
        with pytest.raises(InputError, match="cannot be read as results"):
            kind.from_json(given.encode("latin-1"))


def test_a_tolerance_that_no_diagnosis_can_have_is_refused_with_the_file(out):
    content = json.loads(next(out.rglob("diagnosis.json")).read_text())
    content["settings"]["thresholds"]["tolerance"] = 0.7
    with pytest.raises(InputError, match=r"x\.json: cannot be read .*a tolerance of 0\.7"):
        DiagnosisResult.from_json(json.dumps(content), file="x.json")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_number_that_is_not_finite_is_never_written(tmp_path, value):
    check = CheckResult(pad="B", noise=value, cells=())
    with pytest.raises(ValueError, match="not JSON compliant"):
        check.write(tmp_path / "check.json")
    assert not list(tmp_path.iterdir())


def test_a_record_is_not_changed_once_it_is_made():
    estimate = Estimate("N", 1.0, 0.1)
    with pytest.raises(AttributeError):
        estimate.mean = 2.0
    assert msgspec.structs.replace(estimate, mean=2.0).mean == 2.0


def test_every_setting_of_the_diagnosis_has_words_of_its_own_in_the_report():
    every = settings_rows(DiagnosisSettings())
    assert all(words for words, _ in every)
    assert len({words for words, _ in every}) == len(every) <= 60  # that can move a verdict
