"""Check that statements on single constants are understood, or refused with a remedy."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.stats import kstest
from support.endtoend import experiment
from support.machine_files import refusals

from qlvbayes.fitting.posterior import Predictor
from qlvbayes.io.checks import InputError
from qlvbayes.laws.motion import Motion
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import Choices, default_model
from qlvbayes.model.noise import NOISES, Correlated, Floor, White
from qlvbayes.model.overrides import in_words, override, parse, parse_prior
from qlvbayes.model.parameters import draw_priors, fields_of, names, unconstrained, unit_kinds
from qlvbayes.motion.record import Blocks, Record, batch
from qlvbayes.priors import Dirichlet, HalfNormal, LogNormal, LogUniform, Normal, Ordered, Uniform

SCALES = Scales(force=2.0, depth=1.6, shortest=1e-3, longest=30.0, white=0.006, ou=0.008, tau=0.5)
MODEL = default_model(SCALES)
NOISE = Correlated(0.006, 0.008, 0.5)


def applied(*texts, part=MODEL, fixed=False):
    return override(part, [parse(text, fixed=fixed) for text in texts])


def predictor(model=MODEL, noise=NOISE):
    time, depth = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.6, 1.6])
    blocks = Blocks.of_means(depth, np.ones(3), time, time)
    motion = Motion(time, depth, np.zeros(3), np.zeros(3))
    nodes = np.stack([np.arange(3)] * 2, axis=1)
    return Predictor.from_model(model, noise, batch([Record(motion, nodes, blocks)]))


@pytest.mark.parametrize(
    "prior",
    [Normal(-1.0 / 3.0, 0.1 + 0.2), LogNormal(1.8, np.float64(1e-17)), HalfNormal(2.5e-300),
     Uniform(-1, 1), LogUniform(0.01, 100.0), Dirichlet([1.0, 1.0 / 3.0, 2.0])],
)  # fmt: skip
def test_a_prior_in_words_is_the_same_prior(prior):
    """To the last digit."""
    again = parse_prior(in_words(prior))
    assert type(again) is type(prior)
    for field in dataclasses.fields(prior):
        one, other = (np.asarray(getattr(x, field.name)).tolist() for x in (prior, again))
        assert one == other


def test_priors_are_given_as_objects_or_as_words():
    told = ("v[1]=lognormal(1.8,0.5)", "m=lognormal(0.25,2.0)")
    words = Choices(priors=told, fixed=["v[2]=0.14"])
    given = {"v[1]": LogNormal(1.8, 0.5), "m": "lognormal(0.25,2.0)"}
    assert Choices(priors=given, fixed={"v[2]": 0.14}) == words
    assert Choices(priors="m=lognormal(0.25,2.0)").priors == ("m=lognormal(0.25,2.0)",)
    assert Choices.from_dict(json.loads(json.dumps(words.as_dict()))) == words
    assert dataclasses.replace(words, modes=3).priors == words.priors
    model = Choices(priors={"v[1]": LogNormal(1.8, 0.5)}, fixed={"v[2]": "0.14"}).build(SCALES)[0]
    assert model.relaxation.v.members[0].log_median == 1.8
    assert model.relaxation.v.members[1] == 0.14


@pytest.mark.parametrize(
    "prior", [Ordered((LogNormal(0.0, 1.0),)), Dirichlet([1.0, 1.0, 1.0], {0: 0.2})]
)
def test_a_prior_that_has_no_words_is_refused(prior):
    with pytest.raises(InputError, match="cannot be kept with the results; use one of normal"):
        Choices(priors={"c": prior})


GOOD = [
    ("normal(0,1)", Normal, (0.0, 1.0)),
    ("lognormal(1.8,0.5)", LogNormal, (1.8, 0.5)),
    (" lognormal ( 1.8 , 0.5 ) ", LogNormal, (1.8, 0.5)),
    ("halfnormal(2e-2)", HalfNormal, (0.02,)),
    ("uniform(-1,1)", Uniform, (-1.0, 1.0)),
    ("loguniform(0.01,100)", LogUniform, (0.01, 100.0)),
]


@pytest.mark.parametrize(("text", "kind", "values"), GOOD)
def test_priors_are_read(text, kind, values):
    prior = parse_prior(text)
    assert type(prior) is kind
    assert tuple(getattr(prior, name) for name in kind.__annotations__)[: len(values)] == values


def test_dirichlet_takes_any_number_of_concentrations_and_messages_are_one_line():
    prior = parse_prior("dirichlet(1, 2, 0.5)")
    assert isinstance(prior, Dirichlet)
    assert prior.alpha.tolist() == [1.0, 2.0, 0.5]
    with pytest.raises(InputError) as caught:
        applied("m=\n-1", fixed=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["v[2]=", "v[2]=inf", "v[2]=nan", "v[2]=lognormal(1,1)"])
def test_what_is_not_a_number_is_refused(text):
    with pytest.raises(InputError, match="write a number"):
        parse(text, fixed=True)


@pytest.mark.parametrize(("how", "texts", "remedy"), refusals("statements"))
def test_what_is_no_prior_or_does_not_fit_its_constant_is_refused_with_a_remedy(how, texts, remedy):
    given = [texts] if how == "prior" else texts.split()
    with pytest.raises(InputError, match=remedy):
        applied(*given, fixed=how == "fixed")


def test_what_is_named_is_replaced_and_nothing_else():
    model = applied("m=lognormal(-1,0.2)")
    assert model.elastic.m.describe() == "lognormal(-1, 0.2)"
    assert model.elastic.b is MODEL.elastic.b
    assert model.relaxation is not None
    assert applied("b=0.577", fixed=True).elastic.b == 0.577
    assert applied("m=uniform(0,1)").elastic.m.describe() == "uniform(0, 1)"
    model = applied("v[1]=lognormal(1.8,0.5)")
    model = applied("v[2]=0.14", part=model, fixed=True)
    rates = model.relaxation.v
    assert isinstance(rates, Ordered)
    assert rates.describe() == "lognormal(1.8, 0.5) > 0.14"
    assert rates.size == 1
    model = applied("c[0]=0.3", fixed=True)
    model = applied("c=dirichlet(1,2,3)", part=model)
    fractions = model.relaxation.c
    assert fractions.describe() == "dirichlet(1, 2, 3), [0] = 0.3"
    assert fractions.size == 1
    noise = applied("noise.white=0.01", part=NOISE, fixed=True)
    assert noise.white == 0.01
    assert noise.ou is NOISE.ou
    with pytest.raises(InputError, match=r"use one of noise.white, noise.ou, noise.tau"):
        applied("white=0.01", part=NOISE, fixed=True)


def test_fixed_constants_leave_theta_keep_names_and_units_and_the_order():
    whole = predictor()
    assert names(whole) == [
        "m", "b", "c[0]", "c[1]", "c[2]", "v[1]", "v[2]", "noise.white", "noise.ou", "noise.tau",
    ]  # fmt: skip
    assert unit_kinds(whole) == [
        "stiffness", "exponent", *["fraction"] * 3, *["rate"] * 2, "force", "force", "time",
    ]  # fmt: skip
    assert len({field.name for field in fields_of(whole.model)}) == 4
    model = applied("v[2]=0.14", "c[0]=0.3", "b=0.577", fixed=True)
    whole = predictor(model)
    assert whole.size == predictor().size - 3
    assert names(whole) == names(predictor())
    values, log = whole.parameters.bound(draw_priors(whole.model, 1, np.random.default_rng(2)))
    constants = dict(zip(names(whole), values[0], strict=True))
    assert (constants["v[2]"], constants["c[0]"], constants["b"]) == (0.14, 0.3, 0.577)
    assert np.isfinite(log[0])


@pytest.mark.parametrize(("law", "modes"), [("exponential", 3), ("linear", 1), ("hertz", 2)])
@pytest.mark.parametrize("kind", NOISES)
def test_constants_come_back_from_theta_under_every_law_and_noise(law, modes, kind):
    whole = predictor(default_model(SCALES, law, modes), NOISES[kind].default(SCALES))
    theta = draw_priors(whole.model, 1, np.random.default_rng(1))[0]
    assert theta.shape == (whole.size,)
    (constants,) = whole.parameters.constants(theta[None])
    assert len(names(whole)) == len(unit_kinds(whole)) == constants.size
    for leaf in whole.parameters.leaves:
        own = constants[list(leaf.constants)]
        back = unconstrained(leaf.prior, own[None] if own.size > 1 else own)[0]
        assert np.allclose(back, theta[list(leaf.theta)], atol=1e-7)


def test_unknown_laws_and_noises_are_refused_and_prior_draws_are_of_the_prior():
    with pytest.raises(InputError, match="use one of exponential"):
        default_model(SCALES, "cubic")
    with pytest.raises(InputError, match="use one of floor, white"):
        Choices(noise="pink")
    model, _ = Choices().build(experiment().scales)
    draws = draw_priors(model, 400, np.random.default_rng(0))
    assert draws.shape == (400, 6)
    m = model.elastic.m
    standard = (draws[:, 0] - float(m.log_median)) / float(m.log_sd)
    assert kstest(standard, "norm").pvalue > 1e-3


def test_sample_sd_is_that_of_a_single_sample():
    samples = Blocks.of_means(
        np.zeros(2), np.ones(2), np.arange(2.0), np.arange(2.0), np.array([1.0, 2.0])
    )
    correlated = np.hypot([0.3, 0.6], 0.4)
    assert np.allclose(White(0.4).sample_sd(samples), [0.4, 0.8])
    assert np.allclose(Correlated(0.3, 0.4, 1.0).sample_sd(samples), correlated)
    assert np.allclose(Floor(0.3, 0.4, 1.0, 2.0, 0.1).sample_sd(samples), 2.0 * correlated)
