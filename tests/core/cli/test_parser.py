"""The words of the command line."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from core.cli.parser import BENCHMARK_NAMES, build_parser
from core.export import mesh, video
from core.lab.benchmarks.bench import BENCHMARKS

_ROOT = Path(__file__).parents[3]


def test_help_answers_without_torch() -> None:
    code = """
import contextlib, sys
from core.cli.parser import parse
commands = "|fit|train|evaluate|bench|bench all|dataset|dataset meshes|turntable|mesh"
for words in commands.split("|"):
    with contextlib.suppress(SystemExit):
        parse([*words.split(), "--help"])
assert not {"torch", "numpy", "PIL"} & {*sys.modules}
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    words = done.stdout.replace("|", " ").replace(",", " ").split()
    for word in (
        "--estimate-focal",
        "--init",
        "--quick",
        "--variants",
        ".frames",
        "paper",
        "M1",
        "boats",
        "64",
        "96",
    ):
        assert any(word in printed for printed in words), word


@pytest.mark.parametrize(
    ("command", "words", "values"),
    [
        ("render --out a.png", "--paint seat=c03028 --paint 204080", 2),
        ("render --out a.png", "--edit rounder=1,darker=1 --edit softer=-1", 3),
        ("fit a.png", "--point 1,2 3,4 --point 5,6", 3),
        ("mesh --out a.glb", "--variants a.png --variants b.png", 2),
    ],
)
def test_a_repeated_option_adds_its_values(command: str, words: str, values: int) -> None:
    name = words.split()[0].removeprefix("--")
    for _ in range(2):  # defaults are not extended
        assert len(vars(build_parser().parse_args([*command.split(), *words.split()]))[name]) == values


def test_a_benchmark_without_the_extra_lab_names_the_missing_package() -> None:
    code = "import sys; sys.modules['pandas'] = None; from core.__main__ import main; main(['bench', 'page'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.endswith("this command needs pandas: pip install 'codenerf-viewer[lab]'")


def test_help_lists_every_benchmark() -> None:
    assert tuple(BENCHMARKS) == BENCHMARK_NAMES


def test_help_tells_every_default_once() -> None:
    commands = next(iter(build_parser()._subparsers._group_actions)).choices
    for command in commands.values():
        texts = [command._get_formatter()._get_help_string(action) or "" for action in command._actions]
        assert max(text.count("(default: ") for text in texts) <= 1


def test_help_lists_every_format_that_can_be_written() -> None:
    """They are written out in the parser, as the tables hold writers that load torch."""
    commands = next(iter(build_parser()._subparsers._group_actions)).choices
    for name, formats in (("turntable", video.FORMATS), ("mesh", mesh.FORMATS)):
        (out,) = (action for action in commands[name]._actions if action.dest == "out")
        assert out.metavar == "X" + "|".join(formats)


@pytest.mark.parametrize(("script", "module"), [("codenerf", "core.__main__"), ("codenerf-viewer", "viewer.__main__")])
def test_a_console_script_works_and_names_itself_beside_packages_of_the_same_names(
    script: str, module: str, tmp_path: Path
) -> None:
    scripts = tomllib.loads((_ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts[script] == f"{module}:main"
    for package in ("core", "viewer"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise ImportError('of this folder')")
    path = tmp_path / "bin" / script  # as pip writes it
    path.parent.mkdir()
    path.write_text(f"import sys\nfrom {module} import main\nsys.exit(main())\n")
    options = {"capture_output": True, "text": True, "check": False, "cwd": tmp_path}
    environment = os.environ | {"PYTHONPATH": str(_ROOT)}
    done = subprocess.run([sys.executable, str(path), "--help"], env=environment, **options)
    assert done.stdout.startswith(f"usage: {script} "), done.stderr
    done = subprocess.run([sys.executable, str(path), "--no-such-option"], env=environment, **options)
    assert done.returncode == 2
    assert f"{script}: " in done.stderr
