"""Functions of the documented interface describe their parameters."""

import importlib
import inspect

import pytest

INTERFACE = (
    "spacerobot",
    "spacerobot.closedloop",
    "spacerobot.description",
    "spacerobot.dynamics",
    "spacerobot.elements",
    "spacerobot.linear",
    "spacerobot.result",
    "spacerobot.rollout",
    "spacerobot.scene",
    "optim",
    "optim.campaign",
    "optim.comparison",
    "optim.methods",
    "optim.planning",
    "optim.problem",
    "optim.robust",
    "optim.search",
    "optim.workers",
)
OWN = ("spacerobot.", "optim.")


def functions_of(module):
    """Functions that a package exports, and public methods of its classes, by name."""
    names = getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")])
    for value in (getattr(module, name) for name in names):
        if inspect.isfunction(value) and value.__module__.startswith(OWN):
            yield value.__qualname__, value
        elif inspect.isclass(value):
            for kind in (kind for kind in value.__mro__ if kind.__module__.startswith(OWN)):
                for name, method in vars(kind).items():
                    function = getattr(method, "__func__", method)
                    if not name.startswith("_") and inspect.isfunction(function):
                        yield f"{kind.__qualname__}.{name}", function


@pytest.mark.parametrize("name", INTERFACE)
def test_functions_of_two_or_more_parameters_describe_them(name):
    missing = set()
    for label, function in functions_of(importlib.import_module(name)):
        parameters = [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]
        own = function.__code__.co_filename != "<string>"  # of data classes
        if own and len(parameters) > 1 and "Args:\n" not in (inspect.getdoc(function) or ""):
            missing.add(label)
    assert not missing
