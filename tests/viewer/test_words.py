"""One thing has one name in the window: in the viewer's own texts the names that things had before do not come back.

Errors of core, which are shown as they are, speak of fits.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import viewer

_SOURCE = Path(viewer.__file__).parent
_FORMER = re.compile(
    r"\b(races?|raced|visited|plausib\w+|sheets?|codes?|fit|fits|fitted|fitting|hypothes\w+|looking for)\b",
    re.IGNORECASE,
)
_ABBREVIATED = re.compile(r"\bSDs?\b")


def texts(source: str) -> Iterator[str]:
    """What a person reads: it begins with a capital letter, or has three words; names of jobs and widgets have less."""
    tree = ast.parse(source)
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            text = node.value.partition("##")[0].strip()
            if text[:1].isupper() or len(text.split()) > 2:
                yield text


def test_no_former_word_is_in_the_window() -> None:
    files = set(_SOURCE.rglob("*.py")) - {_SOURCE / "screen" / "window.py"}  # it knows what layouts were called
    found = [
        f"{file.relative_to(_SOURCE)}: {text}"
        for file in sorted(files)
        for text in texts(file.read_text("utf-8"))
        if _FORMER.search(text) or _ABBREVIATED.search(text)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ('title = "Codes"', ["Codes"]),
        ('button("Race###race", f"out of {number} sheets")', ["Race"]),
        ('tooltip(f"{name} is being fitted")', ["is being fitted"]),
        ('"""The codes of a race."""', []),
        ('jobs.submit(Job("fit view", stream))', []),
    ],
)
def test_texts_are_told_from_names(source: str, expected: list[str]) -> None:
    assert list(texts(source)) == expected
