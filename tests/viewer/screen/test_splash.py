"""The window of the first seconds. Each in a process of its own, where nothing is imported yet."""

import os
import subprocess
import sys
from pathlib import Path

from tests.viewer.machine import slowness

_PROGRAM = """
import sys
import moderngl
from viewer.screen import window
from viewer.screen.splash import Splash

def work():
    {work}

drawn = []
def finish():
    drawn.append("torch" in sys.modules)
    if {close} and len(drawn) > 20:
        splash.params.app_shall_exit = True
    moderngl.get_context().finish()

window.prepare(headless=True)
splash = Splash(work)
window.make_headless(splash.params, finish)
try:
    print("got", splash.run())
except ValueError as error:
    print("failed:", error)
print("torch at first:", drawn[0])
"""


def start(work: str, close: bool = False) -> list[str]:
    """The lines that a program prints which does some work behind a splash."""
    code = _PROGRAM.format(work=work, close=close)
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=120 * slowness(),
        check=True,
    )
    return done.stdout.splitlines()


def test_the_splash_is_on_screen_before_torch_is_imported(opengl: None) -> None:
    lines = start("import torch; return len(drawn)")
    frames = int(lines[0].removeprefix("got "))
    assert frames > 0
    assert lines[1] == "torch at first: False"


def test_failures_and_closing_end_the_program(opengl: None) -> None:
    assert start("raise ValueError('no such library')", close=True)[0] == "failed: no such library"
    while_it_runs = "import threading, time\n    while threading.main_thread().is_alive(): time.sleep(0.01)"
    assert start(while_it_runs, close=True) == []
