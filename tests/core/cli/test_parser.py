"""The words of the command line."""

import subprocess
import sys

from core.cli.parser import build_parser
from core.export import mesh, video


def test_help_answers_without_torch() -> None:
    code = """
import contextlib, sys
from core.cli.parser import parse
commands = "|fit|train|evaluate|bench|bench ablations|dataset|dataset pairs|turntable|mesh"
for words in commands.split("|"):
    with contextlib.suppress(SystemExit):
        parse([*words.split(), "--help"])
assert "torch" not in sys.modules and "numpy" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    words = done.stdout.replace("|", " ").replace(",", " ").split()
    for word in ("--estimate-focal", "--init", "ablations", "--meshes", ".frames", "paper", "M1", "boats", "64", "96"):
        assert any(word in found for found in words), word


def test_the_formats_in_help_are_those_that_can_be_written() -> None:
    """They are written out in the parser, as the tables hold writers that load torch."""
    commands = next(iter(build_parser()._subparsers._group_actions)).choices
    for name, formats in (("turntable", video.FORMATS), ("mesh", mesh.FORMATS)):
        (out,) = (action for action in commands[name]._actions if action.dest == "out")
        assert out.metavar == "X" + "|".join(formats)
