"""Every public name says what it is: what `help` and a notebook show."""

import dataclasses
import inspect
import re

import pytest

import quadrille

PUBLIC = [name for name in quadrille.__all__ if inspect.isclass(getattr(quadrille, name)) or callable(getattr(quadrille, name))]
OTHERS = [name for name in quadrille.__all__ if name not in PUBLIC]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_and_all_its_attributes_are_documented(name):
    of = getattr(quadrille, name)
    assert inspect.getdoc(of), name
    if not inspect.isclass(of):
        return
    said = of.__doc__
    fields = {field.name for field in dataclasses.fields(of)} if dataclasses.is_dataclass(of) else set()
    public = {key: value for key, value in vars(of).items() if not key.startswith("_")}
    silent = [f for f in fields if not f.startswith("_") and not re.search(rf"^ *{f}: \S", said, re.M)]
    silent += [key for key, value in public.items() if key not in fields and not inspect.getdoc(value)]
    assert not silent, f"{name}: {silent} say nothing"


def test_what_is_neither_a_class_nor_a_function_stands_in_the_documentation_of_the_module():
    assert OTHERS and not [name for name in OTHERS if f"``{name}``" not in quadrille.__doc__]


@pytest.mark.parametrize("name", [name for name in PUBLIC if inspect.isfunction(getattr(quadrille, name))])
def test_every_argument_of_a_function_is_named(name):
    everywhere = {"output", "overwrite", "device", "isa", "threads", "on_event", "seed", "case", "options"}
    everywhere |= {"max_seconds", "max_evaluations"}
    function = getattr(quadrille, name)
    for argument in set(inspect.signature(function).parameters) - everywhere:
        assert re.search(rf"\b{argument}\b", function.__doc__), argument
