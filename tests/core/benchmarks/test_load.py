"""A stub stands in for the work: what is tested is what runs beside what, how often, and what is made of it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.benchmarks.csv_files import append_record, read_records
from core.benchmarks.load import MEASURED, ONE, LoadResults, Timing, busy_processes, jobs_of, run
from core.benchmarks.load_charts import draw_load, read_load
from core.benchmarks.tables import load_table
from core.rendering.progressive import Frame
from tests.conftest import image_size
from tests.core.tiny import tiny_model


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def test_every_job_runs_in_turn_beside_every_number_of_busy_processes():
    threads = list[int]()

    def stub() -> Iterator[int]:
        threads.append(torch.get_num_threads())
        yield 1

    timings = list(run({"stub": stub}, 2, busy_counts=(0, 1)))
    assert [one.key for one in timings] == [
        ("stub", which, busy, turn)
        for turn, order in ((0, (MEASURED, ONE)), (1, (ONE, MEASURED)))
        for busy in (0, 1)
        for which in order
    ]
    assert len(threads) == 1 + len(timings)  # once more before the first, to warm up
    assert all(count == 1 for count, one in zip(threads[1:], timings, strict=True) if one.threads == ONE)
    assert all(one.seconds > 0 for one in timings)
    assert torch.get_num_threads() == 2


def test_a_resumed_run_leaves_out_what_is_done():
    began = list[int]()

    def stub() -> Iterator[int]:
        began.append(1)
        yield 1

    everything = list(run({"stub": stub}, 2, busy_counts=(0,)))
    some = {one.key for one in everything[:3]}
    assert [one.key for one in run({"stub": stub}, 2, some, (0,))] == [everything[3].key]
    began.clear()
    assert not list(run({"stub": stub}, 2, {one.key for one in everything}, (0,)))
    assert not began


def test_where_torch_has_one_thread_there_is_nothing_to_compare():
    torch.set_num_threads(1)
    with pytest.raises(ValueError, match="one thread"):
        next(run({}, 1))


def test_busy_processes_end_with_the_block_also_after_an_error():
    with busy_processes(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.poll() is not None for process in processes)
    with pytest.raises(RuntimeError), busy_processes(1) as processes:
        raise RuntimeError
    assert processes[0].poll() is not None


def test_a_turn_around_an_object_can_begin_again():
    torch.set_num_threads(1)
    jobs = jobs_of(tiny_model())
    assert list(jobs) == ["fit, draft", "fit, normal", "24 images, 256 px"]
    frames = [next(iter(jobs["24 images, 256 px"]())) for _ in range(2)]
    assert all(frame is None or isinstance(frame, Frame) for frame in frames)


def timing(job: str, threads: str, busy: int, turn: int, seconds: float) -> Timing:
    return Timing(job, threads, busy, turn, seconds, seconds, 0.25)


ROWS = tuple(
    timing("fit", threads, busy, turn, seconds + turn)
    for turn in range(3)
    for threads, busy, seconds in ((ONE, 0, 1.0), (MEASURED, 0, 0.5), (ONE, 1, 3.0), (MEASURED, 1, 2.0))
)


def test_ratios_are_to_the_median_of_one_thread_beside_nothing():
    found = LoadResults("a machine", ROWS)
    assert (found.jobs, found.turns, found.busy_counts) == (["fit"], 3, [0, 1])
    assert found.ratios("fit", MEASURED, 1) == [1.0, 1.5, 2.0]
    assert LoadResults("m", ROWS[1:2]).ratios("fit", MEASURED, 0) == []
    table = load_table(found)
    assert "medians of 3 turns; load average before: 0.2 to 0.2" in table
    assert "| fit | 1 | 4.00 s | 2.00 | 3.00 s | 1.50 | 0.75 | 0.75 |" in table
    assert "load average" not in load_table(LoadResults("m", tuple(replace(one, load=None) for one in ROWS)))


def test_rows_are_kept_one_by_one_and_drawn(tmp_path: Path):
    path, about = tmp_path / "load.csv", {"machine": "a machine"}
    assert read_records(path, Timing, about) == ()
    for row in ROWS:
        append_record(path, about, row)
    assert read_records(path, Timing, about) == ROWS
    with pytest.raises(ValueError, match=r"machine 'a machine', and now 'another'"):
        read_records(path, Timing, {"machine": "another"})
    assert read_load(path) == LoadResults("a machine", ROWS)
    draw_load(tmp_path)
    assert image_size(tmp_path / "load.png")[0] > 300
    assert (tmp_path / "load.md").read_text() == load_table(read_load(path))
