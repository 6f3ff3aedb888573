"""The words of the command line: today's, and those of before, which are still understood."""

import subprocess
import sys

import pytest

from core.cli.legacy import current_words
from core.cli.parser import build_parser, parse
from core.export import mesh, video

TRAIN = "train d --out m.safetensors"


@pytest.mark.parametrize(
    ("before", "today"),
    [
        ("glance d --out m.safetensors", "train-viewpoint d --out m.safetensors"),
        ("bench parts", "bench ablations"),
        ("bench stability --objects 3", "bench robustness --objects 3"),
        ("bench size d --tests t --models m", "bench model-size d --tests t --models m"),
        ("fit a.png --lens", "fit a.png --estimate-focal"),
        ("evaluate d --swap", "evaluate d --disentanglement"),
        ("evaluate d --inputs 3,4 --every 5", "evaluate d --input-views 3,4 --view-stride 5"),
        ("evaluate d --inputs=3,4 --every=5", "evaluate d --input-views=3,4 --view-stride=5"),
        (
            "dataset swap --count 40 --blocks 2 --category cars --out d",
            "dataset pairs --count 40 --tables 2 --category cars --out d",
        ),
        (f"{TRAIN} --from cars --recipe ours", f"{TRAIN} --init cars --recipe default"),
        (f"{TRAIN} --recipe=ours", f"{TRAIN} --recipe=default"),
    ],
)
def test_words_of_before_mean_those_of_today(before: str, today: str) -> None:
    assert current_words(before.split()) == today.split()
    assert parse(before.split()) == parse(today.split())


@pytest.mark.parametrize(
    "words", ["render --out ours.png", "mesh --scene --from --out x", f"{TRAIN} --device ours", ""]
)
def test_no_other_word_is_changed(words: str) -> None:
    assert current_words(words.split()) == words.split()


def test_help_answers_without_torch_and_shows_the_words_of_today_only() -> None:
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
    for word in (
        "--estimate-focal",
        "--init",
        "ablations",
        "--tables",
        ".frames",
        "paper",
        "M1",
        "chairs}",
        "64",
        "96",
    ):
        assert any(word in found for found in words), word
    for word in (
        "--lens",
        "--swap",
        "--inputs",
        "--every",
        "--blocks",
        "--from",
        "glance",
        "parts",
        "stability",
        "ours",
    ):
        assert word not in words


def test_the_formats_in_help_are_those_that_can_be_written() -> None:
    """They are written out in the parser, as the tables hold writers that load torch."""
    commands = next(iter(build_parser()._subparsers._group_actions)).choices
    for name, formats in (("turntable", video.FORMATS), ("mesh", mesh.FORMATS)):
        (out,) = (action for action in commands[name]._actions if action.dest == "out")
        assert out.metavar == "X" + "|".join(formats)
