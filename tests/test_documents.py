"""The documents describe the program: links and files exist, commands parse, names and the lines of Python resolve."""

import ast
import builtins
import importlib
import inspect
import re
import shlex
from functools import cache
from pathlib import Path
from textwrap import dedent
from types import ModuleType

import pytest

from core.cli.parser import build_parser

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = (
    "README.md",
    "core/README.md",
    "viewer/README.md",
    "assets/charts/README.md",
    "assets/charts/tried.md",
    "assets/models/README.md",
    "assets/CREDITS.md",
)
_FRONT_PAGE_LINES = 130


def test_the_front_page_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= _FRONT_PAGE_LINES


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_link_leads_to_a_file_and_a_heading(name: str) -> None:
    document = ROOT / name
    for target, heading in re.findall(r"\]\(([^)#]*)#?([^)]*)\)", document.read_text()):
        if "://" not in target:
            file = document.parent / target if target else document
            assert file.exists(), target
            assert not heading or heading in _headings(file), f"{target}#{heading}"


def _headings(file: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", file.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_command_parses(name: str) -> None:
    for line in re.findall(r"(?:^|`)python -m core ([^`\n]*)", (ROOT / name).read_text(), re.MULTILINE):
        if "--help" not in line:
            build_parser().parse_args(shlex.split(_one_of(line)))


def _one_of(line: str) -> str:
    """A documented command without its comment, with its [--options], the first of its a|b, numbers for letters."""
    options = re.sub(r"\[(--[^]]*)\]", r"\1", line.partition("#")[0])
    return re.sub(r" [NST]\b", " 1", re.sub(r"\[[^]]*\]|\|\S+", "", options))


def test_the_guide_to_core_names_existing_modules_and_functions() -> None:
    text = (ROOT / "core/README.md").read_text()
    for path in re.findall(r"`([\w/]+/(?:\w+\.(?:py|json))?)`", text):
        assert (ROOT / "core" / path).exists() or (ROOT / path).exists(), path
    for name in re.findall(r"`([A-Z]\w+)`", text):
        assert hasattr(builtins, name) or re.search(rf"^(class )?{name}\b *[:=(]", _source(), re.MULTILINE), name


@cache
def _source() -> str:
    return "\n".join(path.read_text() for path in sorted((ROOT / "core").rglob("*.py")))


@pytest.mark.parametrize("name", DOCUMENTS)
def test_lines_of_python_in_documents_call_existing_functions(name: str) -> None:
    for block in re.findall(r"^ *```python\n(.*?)^ *```", (ROOT / name).read_text(), re.DOTALL | re.MULTILINE):
        tree = ast.parse(dedent(block))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        imported = {alias.name: _imported(str(node.module), alias.name) for node in imports for alias in node.names}
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            function = _resolved(call.func, imported)
            if inspect.isfunction(function):
                inspect.signature(function).bind(*call.args, **{str(word.arg): word.value for word in call.keywords})


def _imported(module: str, name: str) -> object:
    try:
        return getattr(importlib.import_module(module), name)
    except AttributeError:
        return importlib.import_module(f"{module}.{name}")


def _resolved(node: ast.expr, imported: dict[str, object]) -> object:
    """The imported function that a call names; None for a function that was not imported."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        module = imported.get(node.value.id)
        return getattr(module, node.attr) if isinstance(module, ModuleType) else None
    return imported.get(node.id) if isinstance(node, ast.Name) else None
