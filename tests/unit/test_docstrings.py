"""The examples in docstrings print what they say."""

import doctest
from importlib import import_module
from pkgutil import walk_packages

import pytest

import mdtopo

MODULES = [module.name for module in walk_packages(mdtopo.__path__, "mdtopo.") if module.name != "mdtopo.__main__"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_are_right(name: str) -> None:
    assert doctest.testmod(import_module(name)).failed == 0


def test_there_are_examples() -> None:
    assert sum(len(test.examples) for test in doctest.DocTestFinder().find(import_module("mdtopo.polyline"))) > 5
