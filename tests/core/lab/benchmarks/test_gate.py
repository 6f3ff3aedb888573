import math
from itertools import islice
from pathlib import Path

import pytest

from core.lab.benchmarks.gate import busy_processes, compare, measure_ratios, read_baseline, write_baseline
from core.models.model import Model

BASELINE = Path(__file__).parents[4] / "assets/charts/gate.csv"
USUAL = {"a fit against steps": 3.0, "a bank against a search": 0.05}


def test_ratios_within_twice_the_baseline_pass_and_missing_ones_fail():
    assert not compare(USUAL, USUAL)
    assert not compare({name: 1.9 * value for name, value in USUAL.items()}, USUAL)
    assert compare({"a fit against steps": 3.0}, USUAL) == ["a bank against a search: 0.05, now missing"]
    assert compare(USUAL | {"a bank against a search": math.nan}, USUAL)


@pytest.mark.parametrize("slow", USUAL)
def test_the_slow_ratio_is_named(slow: str):
    ratios = {name: (2.1 if name == slow else 0.5) * value for name, value in USUAL.items()}
    (line,) = compare(ratios, USUAL)
    assert line.startswith(f"{slow}: {USUAL[slow]:g}, now ")


def test_the_committed_baseline_names_the_measured_ratios(tmp_path: Path, tiny: Model):
    write_baseline(tmp_path / "gate.csv", USUAL)
    assert read_baseline(tmp_path / "gate.csv") == USUAL
    with pytest.raises(ValueError, match="no baseline"):
        read_baseline(tmp_path / "none.csv")
    ratios = dict(islice(measure_ratios(tiny), 2))
    assert list(ratios) == list(read_baseline(BASELINE))[:2]
    assert min(ratios.values()) > 0


def test_busy_processes_end_with_the_block_even_after_an_error():
    with busy_processes(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.poll() is not None for process in processes)
    with pytest.raises(RuntimeError), busy_processes(1) as processes:
        raise RuntimeError
    assert processes[0].poll() is not None
