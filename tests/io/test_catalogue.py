"""Check that each path of what users choose by name leads to the class of that name."""

import pytest

from qlvbayes.io.catalogue import ELASTIC, NOISES, RELAXATION, TARGETS, loaded


@pytest.mark.parametrize("paths", [ELASTIC, RELAXATION, NOISES, TARGETS])
def test_a_class_is_called_as_it_is_listed(paths):
    assert [kind.name for kind in loaded(paths).values()] == list(paths)
