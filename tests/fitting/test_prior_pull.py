"""A constant whose estimate lies far out of its prior is told, with an option that works."""

import re
import shlex

import pytest

from qlvbayes.fitting.summary import Constant, FitSummary, pulled
from qlvbayes.laws.scales import Scales
from qlvbayes.model.choices import Choices
from qlvbayes.model.parameters import described, fields_of

CHOICES = Choices(effects=("frame_compliance", "extra_relaxation_mode"))


SCALES = Scales(force=3.0, depth=1.5, shortest=0.01, longest=30.0, white=0.005, ou=0.003, tau=0.1)


def told(medians, priors=()):
    """The sentences, where the constants have these medians, and their priors."""
    model = Choices(effects=CHOICES.effects, priors=priors).build(SCALES)[0]
    texts = described(fields_of(model))
    constants = {
        name: Constant("1", x, 0.1 * x, x, (0.9 * x, 1.1 * x), None, None)
        for name, x in medians.items()
    }
    return pulled(fit_of(constants), texts)


def fit_of(constants):
    return FitSummary(
        pad="B", effects=CHOICES.effects, sampler="emcee", converged=True, parameters=constants
    )


@pytest.mark.parametrize(
    ("name", "prior", "median", "says"),
    [
        ("frame_compliance.compliance", "halfnormal(0.02)", 0.062, "3.1 prior scales out.*down"),
        ("m", "lognormal(0,0.5)", 0.2, "3.2 prior scales out.*up"),
        ("v[2]", "lognormal(-2,0.3)", 1.0, "6.7 prior scales out.*down"),
        ("b", "uniform(0.5,1.5)", 1.499, "3.1 prior scales out.*down"),
        ("extra_relaxation_mode.v", "loguniform(0.1,10)", 0.1001, "3.5 prior scales out.*up"),
    ],
)
def test_the_option_that_is_told_makes_the_prior_wide_enough(name, prior, median, says):
    (sentence,) = told({name: median}, (f"{name}={prior}",))
    assert sentence.startswith(f"{name}: the estimate lies ")
    assert re.search(says, sentence)
    option, wider = shlex.split(sentence.partition("a wider one: ")[2])
    assert option == "--prior"
    assert told({name: median}, (wider,)) == ()


def test_what_lies_within_its_prior_or_is_fixed_is_not_told():
    within = {"frame_compliance.compliance": 0.045, "m": 1.0, "c[0]": 0.9}
    priors = ("frame_compliance.compliance=halfnormal(0.02)", "m=lognormal(0,0.5)")
    assert told(within, priors) == ()
    fixed = Constant("mm/N", 0.5, 0.0, 0.5, (0.5, 0.5), None, None)
    fit = fit_of({"frame_compliance.compliance": fixed})
    assert pulled(fit, {"frame_compliance.compliance": "fixed at 0.5"}) == ()
