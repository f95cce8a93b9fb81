"""Public namespaces: every name is there, and a package loads nothing before a name is used."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ["spacerobot", "spacerobot.elements", "optim", "viz"]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there_and_hidden_by_no_module(package):
    module = importlib.import_module(package)
    place = Path(module.__file__).parent
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert not (place / name).exists(), name
        assert not (place / f"{name}.py").exists(), name
    assert set(module.__all__) == set(dir(module))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = module.nothing


@pytest.mark.parametrize("package", PACKAGES)
def test_the_stub_consists_of_the_lines_that_are_loaded(package):
    module = importlib.import_module(package)
    tree = ast.parse(Path(module.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    _, *imports = tree.body
    homes = {alias.name: node.module for node in imports for alias in node.names}
    assert list(homes) == module.__all__
    for name, home in homes.items():
        assert getattr(importlib.import_module(home), name) is getattr(module, name), name


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_loads_nothing_before_a_name_is_used(package):
    code = f"import sys, {package}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "casadi", "pinocchio", "pydantic", "matplotlib"}
    ours = {name for name in loaded if name.partition(".")[0] in PACKAGES}
    assert ours <= {package, "spacerobot", "spacerobot.common", "spacerobot.common.lazy_names"}


def test_every_result_of_the_namespace_is_saved_loaded_and_shown():
    import spacerobot as sr

    results = [getattr(sr, name) for name in sr.__all__ if name.endswith("Result")]
    assert len(results) == 12
    for result in results:
        assert {"save", "_repr_html_"} <= set(dir(result)), result
        assert "__repr__" in vars(result), result
        assert result.load.__self__ is result, result
