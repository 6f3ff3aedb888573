"""The words of the command line."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from core.cli.parser import BENCHMARK_NAMES, build_parser
from core.export import mesh, video
from core.lab.benchmarks.bench import BENCHMARKS
from tests.core.cli.conftest import refused

_ROOT = Path(__file__).parents[3]
SIZES = "0x58x92", "60x-5x92", "nanx58x92", "60x58", "1x2x3x4x5", "1e6x1e6x1e6", "60x58x5e4"


def python(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a program of its own."""
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, **options)


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
    done = python("-c", code)
    assert done.returncode == 0, done.stderr
    for word in ["--estimate-focal", "--init", "--quick", "--variants", ".frames", "paper", "M1", "boats", "64", "96"]:
        assert word in done.stdout


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
    done = python("-c", code)
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
    environment = os.environ | {"PYTHONPATH": str(_ROOT)}
    done, failed = (python(path, word, env=environment, cwd=tmp_path) for word in ("--help", "--no-such-option"))
    assert done.stdout.startswith(f"usage: {script} "), done.stderr
    assert failed.returncode == 2 and f"{script}: " in failed.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("render --model {file} --edit taller --out a.png", "edits are NAME=X"),
        ("render --model {file} --paint red --out a.png", "a paint is #rrggbb"),
        ("render --out a.png --model boats", "boats"),
        ("render --out a.png --model {file} --object 9", "0 to 5"),
        ("render --out a.png --elevation 120", "from -90 to 90 degrees"),
        ("render --out a.png --azimuth 1e30", "from -3600 to 3600 degrees"),
        *((f"render --out a.png --distance {words}", "0.05 to 100 scene units") for words in ("-1", "1e30", "1e-30")),
        *((f"render --out a.png --edit taller={words}", "from -10 to 10 standard") for words in ("1e30", "-inf")),
        ("render --out a.png --threads 1000000", "1 to 1024"),
        ("turntable --out a.mp4 --frames 1000000000", "1 to 100000"),
        ("turntable --out a.mp4 --fps 1e30", "1 to 100"),
        *((f"render --out a.png --object 999 --size-cm {size}", "cm") for size in SIZES),
        ("mesh --out a.ply --metres 1e30", "0.0001 to 1e+06"),
        ("mesh --out a.ply --metres 1e-30", "0.0001 to 1e+06"),
        ("mesh --out a.ply --model {file} --texture 1e9", "16 to 8192"),
        ("fit a.png --seed 99999999999999999999", "0 to 4294967295"),
        ("fit a.png --box 0,0,nan,9", "four numbers"),
        ("fit a.png --point inf,9", "two numbers"),
        ("train d --out m.safetensors --latent 4 1e30", "1 to 8192"),
        ("train d --out m.safetensors --shares nan", "1e-06 to 1e+06"),
        ("dataset meshes . --out d --category chairs --variants -1", "0 to 10000"),
        ("evaluate d --input-views -1", "from 0"),
        ("evaluate d --input-views 1e30", "from 0"),
        ("render --out gone/a.png --model {file}", "folder"),
        ("render --out . --model {file}", "it is a folder"),
        ("render --out a.png --size none", "--size"),
        ("render --out a.png --size 8x0", "854x480"),
        ("render --out a.png --azimuth nan", "--azimuth"),
        ("turntable --out t.mp4 --quality 101", "1 to 100"),
        ("mesh --out a.dae --model {file}", "glb"),
        ("convert {file} --out a.safetensors", "hpam.json"),
        ("convert {file} --config {file} --out a.pth", "safetensors"),
        ("evaluate gone --model {file}", "no such dataset"),
        ("evaluate . --model {file} --input-views 64,,1", "--input-views"),
        ("fit gone.png --model {file}", "gone.png"),
        ("fit {file} --model {file}", "m.safetensors"),
        ("fit a.png --out .", "must end in .json"),
        ("fit a.png --log .", "it is a folder"),
        ("fit a.png --log a.png", "cannot write a.png: this command needs it"),
        ("fit a.png --out ./s.json --log s.json", "cannot write s.json: this command needs it"),
        ("fit a.png --mask s.json --out s.json", "cannot write s.json: this command needs it"),
        ("fit a.png --explain {file}", "it is not a folder"),
        ("fit a.png --out gone/a.json", "no folder"),
        ("fit a.png b.png --model {file} --pose p.txt", "as many poses"),
        ("fit a.png --preset best", "paper"),
        ("fit a.png --preset paper --estimate-focal", "focal length"),
        ("fit a.png --pose a.txt --estimate-focal", "--pose gives them"),
        ("bench all --dataset gone", "no such dataset"),
        ("bench page --out gone", "no CSV file"),
        ("bench all --quick --minutes 0 --out gone", "no CSV file"),
        ("train . --init {file} --width 32 --out x.safetensors", "omit --width"),
        ("dataset meshes . --out d --category chairs", "index.json"),
        ("dataset pack . --out d.zip", "must end in .views"),
        ("nonsense", "nonsense"),
        ("", "COMMAND"),
    ],
)
def test_wrong_input_is_named_in_one_line(words: str, message: str, file: str, capsys: pytest.CaptureFixture[str]):
    assert message in refused(capsys, words.format(file=file))
