from itertools import islice
from pathlib import Path

import pytest

from core.lab.benchmarks.gate import Ratio, busy_processes, compare, measure_ratios, read_baseline
from core.lab.benchmarks.results import frame_of, write_frame
from core.models.model import Model

BASELINE = Path(__file__).parents[4] / "assets/charts/gate.csv"
USUAL = (Ratio("a fit against steps", 3.0), Ratio("a bank against a search", 0.05))


def test_ratios_within_twice_the_baseline_pass_and_missing_ones_fail():
    assert not compare(USUAL, USUAL)
    assert not compare([Ratio(ratio.name, 1.9 * ratio.value) for ratio in USUAL], USUAL)
    assert compare(USUAL[:1], USUAL) == ["a bank against a search: 0.05, now missing"]
    assert compare([USUAL[0], Ratio(USUAL[1].name, float("nan"))], USUAL)


@pytest.mark.parametrize("slow", [0, 1])
def test_the_slow_ratio_is_named(slow: int):
    ratios = [Ratio(usual.name, (2.1 if index == slow else 0.5) * usual.value) for index, usual in enumerate(USUAL)]
    (line,) = compare(ratios, USUAL)
    assert line.startswith(f"{USUAL[slow].name}: {USUAL[slow].value:g}, now ")


def test_the_committed_baseline_names_the_measured_ratios(tmp_path: Path, tiny: Model):
    write_frame(tmp_path / "gate.csv", frame_of(USUAL))
    assert read_baseline(tmp_path / "gate.csv") == USUAL
    with pytest.raises(ValueError, match="no baseline"):
        read_baseline(tmp_path / "none.csv")
    ratios = list(islice(measure_ratios(tiny), 2))
    assert [ratio.name for ratio in ratios] == [ratio.name for ratio in read_baseline(BASELINE)[:2]]
    assert all(ratio.value > 0 for ratio in ratios)


def test_busy_processes_end_with_the_block_even_after_an_error():
    with busy_processes(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.poll() is not None for process in processes)
    with pytest.raises(RuntimeError), busy_processes(1) as processes:
        raise RuntimeError
    assert processes[0].poll() is not None
