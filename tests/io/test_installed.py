"""Names that users choose, and effects, laws and formats that installed packages add."""

import importlib
import sys

import pytest

from qlvbayes.effects.catalogue import installed_effects
from qlvbayes.io import catalogue
from qlvbayes.io.catalogue import ELASTIC, NOISES, RELAXATION, TARGETS, loaded
from qlvbayes.io.checks import InputError
from qlvbayes.io.formats import FORMATS, known_formats
from qlvbayes.laws.catalogue import installed_laws
from qlvbayes.model.choices import Choices


@pytest.mark.parametrize("paths", [ELASTIC, RELAXATION, NOISES, TARGETS])
def test_a_class_is_called_as_it_is_listed(paths):
    assert [kind.name for kind in loaded(paths).values()] == list(paths)


EFFECT = '''
from typing import ClassVar

from qlvbayes import xp
from qlvbayes.effects import AbstractEffect, Level
from qlvbayes.priors import Constant


class LabDrag(AbstractEffect):
    """F = F_below + k v |v|."""

    k: Constant
    name: ClassVar[str] = "{name}"
    level: ClassVar[Level] = Level.ADDING
    rank: ClassVar[int] = 41
    units: ClassVar[dict] = {{"k": "count"}}
    null: ClassVar[dict] = {{"k": 0.0}}
    law: ClassVar[str] = "F += k v |v|"
    seen: ClassVar[str] = "steps"
    reference: ClassVar[str] = "a lab"

    @classmethod
    def default(cls, scales):
        return cls(scales.positive(scales.speed**2))

    def force(self, below, motion):
        return below.force(motion) + {term}
'''
RIGHT = "self.k * motion.velocity * xp.abs(motion.velocity)"
LAYOUT = """
from qlvbayes.io.layouts import CHIARO
from dataclasses import replace

OURS = replace(CHIARO, name="our-lab")
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a package of one module, with one entry point."""
    monkeypatch.setenv("QLVBAYES_CACHE", str(tmp_path / "cache" / "jax"))
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(group, target, text):
        info = tmp_path / "our_lab-1.0.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: our-lab\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\nours = our_lab:{target}\n")
        (tmp_path / "our_lab.py").write_text(text)
        importlib.invalidate_caches()
        sys.modules.pop("our_lab", None)
        catalogue.points.cache_clear()

    yield install
    sys.modules.pop("our_lab", None)
    catalogue.points.cache_clear()


def test_an_installed_effect_is_checked_once_and_joins_the_list(install, tmp_path):
    install(catalogue.EFFECT_POINTS, "LabDrag", EFFECT.format(name="lab_drag", term=RIGHT))
    assert [kind.name for kind in installed_effects()] == ["lab_drag"]
    assert (tmp_path / "cache" / "checked.json").exists()
    assert "lab_drag" in [kind.name for kind in Choices(effects=("lab_drag",)).candidates]


@pytest.mark.parametrize(
    ("name", "term", "word"),
    [
        ("lab_drag", "self.k * motion.velocity[-1] ** 2 + motion.velocity", "null"),
        ("friction", RIGHT, "taken"),
        ("lab_drag", "(", "SyntaxError"),
    ],
)
def test_a_broken_one_is_refused_by_its_name(install, name, term, word):
    install(catalogue.EFFECT_POINTS, "LabDrag", EFFECT.format(name=name, term=term))
    with pytest.raises(InputError, match=f"effect ours of the installed package our-lab.*{word}"):
        installed_effects()


def test_an_installed_layout_is_tried_last_and_a_law_that_is_none_refused(install):
    install(catalogue.FORMAT_POINTS, "OURS", LAYOUT)
    assert [kind.name for kind in known_formats()] == [*(f.name for f in FORMATS), "our-lab"]
    install(catalogue.FORMAT_POINTS, "replace", LAYOUT)
    with pytest.raises(InputError, match="no Layout"):
        known_formats()
    install(catalogue.LAW_POINTS, "OURS", LAYOUT)
    with pytest.raises(InputError, match="law ours of the installed package our-lab"):
        installed_laws()
