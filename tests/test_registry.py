"""The functions of diagnostics are called in a stated order, whatever was imported first."""

import random

import pytest

from jaxves.observables import diagnostics, registry


def test_functions_are_called_in_the_order_of_their_files_and_not_of_imports(monkeypatch):
    wanted = [group.formula for group in diagnostics.groups()]
    files = [formula.__module__ for formula in wanted]
    places = [file.__name__ for file in diagnostics.FILES]
    assert [places.index(file) for file in files] == sorted(places.index(file) for file in files)
    by_file = {}
    for group in registry.GROUPS:
        by_file.setdefault(group.formula.__module__, []).append(group)
    blocks = list(by_file.values())
    random.Random(1).shuffle(blocks)
    monkeypatch.setattr(diagnostics, "GROUPS", [group for block in blocks for group in block])
    assert [group.formula for group in diagnostics.groups()] == wanted


def test_a_function_that_no_file_of_the_list_has_is_called_last(monkeypatch):
    own = registry.Group(lambda instant, known: {}, (), lambda scene: True)
    monkeypatch.setattr(diagnostics, "GROUPS", [own, *registry.GROUPS])
    assert diagnostics.groups()[-1] is own


@pytest.mark.parametrize("name", ["deformation", "no such quantity"])
def test_a_quantity_is_given_once_and_has_a_description(name):
    with pytest.raises(ValueError, match=r"expected a name of quantities\.QUANTITIES that no other function gives"):
        registry.gives(name)
