"""How the source is built: which module may import which, and what tests and benchmarks may replace."""

import ast
import re
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parents[1]
_PRIVATE = re.compile(r"([A-Za-z_]\w*\.)*_(?!_)\w+")
"""A name with one leading underscore, or a dotted path that ends in one."""
_REPLACING = {"setattr", "delattr", "setitem", "delitem", "patch", "object", "multiple"}
"""The last words of calls that replace something: of pytest's monkeypatch, of ``unittest.mock``, of the builtins."""


@pytest.mark.parametrize("package", ["core", "viewer"])
def test_no_module_imports_itself_through_others(package: str):
    """Imports for type checking only count too."""
    graph = grimp.build_graph(package, cache_dir=None)
    imports = {module: sorted(graph.find_modules_directly_imported_by(module)) for module in sorted(graph.modules)}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        pytest.fail("import cycle: " + " <- ".join(error.args[1]))


def test_the_layers_of_core_are_at_most_ten():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (core,) = (
        contract for contract in contracts if contract["type"] == "layers" and contract["containers"] == ["core"]
    )
    assert core["exhaustive"]
    assert len(core["layers"]) <= 10


def replaced_privates(source: str) -> Iterator[tuple[int, str]]:
    """Lines that replace a private name of something else, and the name."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and _last_word(node.func) in _REPLACING:
            for name in _named(node.args):
                if _PRIVATE.fullmatch(name):
                    yield node.lineno, name
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store | ast.Del):
            owner = _last_word(node.value)
            if _PRIVATE.fullmatch(node.attr) and owner not in ("self", "cls"):
                yield node.lineno, f"{owner}.{node.attr}"


def _named(arguments: list[ast.expr]) -> Iterator[str]:
    """What the first two arguments name: an owner and its attribute, or a whole path alone."""
    for argument in arguments[:2]:
        if isinstance(argument, ast.Constant):
            yield str(argument.value)
            return
        yield _last_word(argument)


def _last_word(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


@pytest.mark.parametrize(
    "line",
    [
        'monkeypatch.setattr(module, "_NAME", 1)',
        'monkeypatch.setattr("core.module._name", 1)',
        'monkeypatch.setattr(module._Class, "name", 1)',
        'monkeypatch.setitem(module._TABLE, "name", 1)',
        'mock.patch("core.module._name")',
        'mock.patch.object(module, "_name")',
        'setattr(module, "_name", 1)',
        "module._NAME = 1",
        "module._NAME += 1",
        "del module._NAME",
        "module.Class._method = 1",
    ],
)
def test_a_replaced_private_name_is_found(line: str):
    assert list(replaced_privates(line))


@pytest.mark.parametrize(
    "line",
    [
        'monkeypatch.setattr(module, "NAME", _mine)',
        'mock.patch("core.module.name", _mine)',
        "self._name = 1",
        "_name = 1",
        'setattr(thing, "__doc__", "")',
        "a._b",
    ],
)
def test_what_is_public_or_ones_own_may_be_replaced(line: str):
    assert not list(replaced_privates(line))


def test_nothing_patches_a_private_name_of_production_code():
    files = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "core/lab/benchmarks").rglob("*.py")]
    found = [
        f"{file.relative_to(ROOT)}:{line} {name}"
        for file in sorted(files)
        for line, name in replaced_privates(file.read_text())
    ]
    assert not found, "private names are replaced:\n" + "\n".join(found)
