import os
import subprocess
import sys

import pytest

_COUNT = "import torch, numpy; print(torch.get_num_threads())"


def run(program: str, **environment: str) -> str:
    inherited = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, env=inherited | environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_program_computes_in_one_thread_whatever_the_environment_says():
    begun = f"from core.runtime.threads import use_one_thread; use_one_thread(); {_COUNT}"
    assert run(begun, OMP_NUM_THREADS="3", MKL_NUM_THREADS="3") == "1"


@pytest.mark.parametrize("module", ["core.__main__", "viewer.__main__"])
def test_programs_begin_with_that(module: str):
    tried = f"import {module} as program\ntry: program.main(['--help'])\nexcept SystemExit: {_COUNT}"
    assert run(tried, OMP_NUM_THREADS="3").splitlines()[-1] == "1"


def test_the_library_leaves_threads_to_its_caller():
    used = "import torch; torch.set_num_threads(3); import core.fitting.fit, core.photos.photo, core.models.library; "
    assert run(f"{used}core.models.library.load_model('chairs'); {_COUNT}") == "3"
