"""No stream of core or viewer is suspended inside a mode of torch, a lock or an open file.

What is on while a generator is suspended stays on for whoever asked for its value: the worker's next job. So a ``with``
around a ``yield`` is one of a few that are named here with the reason.
"""

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest
import torch

ROOT = Path(__file__).resolve().parents[1]
SAFE = {
    "atomic_file": "a path beside the file, removed when the generator is closed",
    "atomic": "atomic_file or atomic_folder",
    "closing": "a video's file, read, or written by a thread of its own, and closed with the generator",
    "_Encoder": "that thread",
    "renderer": "an own context of OpenGL, current only while it draws",
    "Rasteriser": "the same, for the laboratory's meshes",
}
DECORATORS = ("torch.no_grad", "torch.inference_mode", "torch.enable_grad")
"""Modes that torch switches off between the steps of a generator function, unlike autocast."""
SWITCHES = ("acquire", "__enter__", "enter_context", "set_grad_enabled")
"""Functions that switch a mode on without ``with``."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


def faults(source: str) -> Iterator[str]:
    """Yield the modes that a module's generators leave on at a yield; context managers may."""
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, Function) or not any(_own(function, (ast.Yield, ast.YieldFrom))):
            continue
        decorators = [_name(decorator) for decorator in function.decorator_list]
        if "contextmanager" in decorators:
            continue
        modes = [name for name in decorators if name.startswith("torch.") and name not in DECORATORS]
        switches = [_name(call).rpartition(".")[2] for call in _own(function, (ast.Call,))]
        contexts = [
            _name(item.context_expr)
            for block in _own(function, (ast.With,))
            if _suspends(block)
            for item in block.items
        ]
        held = [
            *modes,
            *(name for name in switches if name in SWITCHES),
            *(name for name in contexts if name not in SAFE),
        ]
        yield from (f"{function.name}: {name}" for name in held)


def _own(node: ast.AST, kinds: tuple[type[ast.AST], ...]) -> Iterator[ast.AST]:
    """The nodes inside a function or block, without those of functions that it defines."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, kinds):
            yield child
        if not isinstance(child, Function | ast.Lambda | ast.ClassDef):
            yield from _own(child, kinds)


def _suspends(block: ast.AST) -> bool:
    return any(_own(block, (ast.Yield, ast.YieldFrom)))


def _name(expression: ast.AST) -> str:
    return ast.unparse(expression.func if isinstance(expression, ast.Call) else expression)


@pytest.mark.parametrize("room", ["core", "viewer"])
def test_no_generator_is_suspended_inside_a_mode_a_lock_or_an_open_file(room: str) -> None:
    held = [
        f"{path.relative_to(ROOT)}: {fault}"
        for path in (ROOT / room).rglob("*.py")
        for fault in faults(path.read_text())
    ]
    assert held == []


@pytest.mark.parametrize(
    "line",
    [
        "with torch.inference_mode(): yield",
        "with torch.no_grad(): value = yield from others()",
        "with torch.autocast('cpu'): return [(yield) for _ in range(3)]",
        "with self._lock: yield",
        "with closing(sink), path.open() as file: yield",
        "with torch.enable_grad():\n        if True:\n            yield",
        "torch.set_grad_enabled(False); yield",
        "lock.acquire(); yield",
        "stack.enter_context(torch.no_grad()); yield",
    ],
)
def test_modes_held_at_a_yield_are_reported(line: str) -> None:
    assert len([*faults(f"def stream():\n    {line}")]) == 1


def test_modes_released_at_a_yield_are_accepted() -> None:
    source = """
        @torch.no_grad()
        def stream():
            yield
            with torch.inference_mode():
                steps = lambda: (yield)
            with atomic_file(path) as unfinished:
                yield
        @contextmanager
        def mode():
            with torch.no_grad():
                yield
        @torch.autocast("cpu")
        def plain():
            with lock:
                def inner():
                    yield
    """
    assert [*faults(dedent(source))] == []
    assert [*faults("@torch.autocast('cpu')\ndef stream(): yield")] == ["stream: torch.autocast"]


@pytest.mark.parametrize(
    ("decorator", "is_on"),
    [
        (torch.no_grad(), lambda: not torch.is_grad_enabled()),
        (torch.inference_mode(), torch.is_inference_mode_enabled),
        (torch.enable_grad(), torch.is_grad_enabled),
    ],
)
def test_torch_takes_these_decorators_off_between_steps(decorator: Callable, is_on: Callable[[], bool]) -> None:
    @decorator
    def stream() -> Iterator[bool]:
        for _ in range(2):
            yield is_on()

    with torch.set_grad_enabled(decorator.__class__ is not torch.enable_grad):
        steps = stream()
        assert next(steps) and not is_on()
        assert next(steps) and not is_on()
        steps.close()
        assert not is_on()
