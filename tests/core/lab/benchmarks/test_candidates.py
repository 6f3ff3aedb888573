import math
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from core.fitting.fit import FitSettings
from core.lab.benchmarks.candidates import KEY, SHIPPED, Budget, Judgement, candidates, judged_cases, measure_candidates
from core.lab.benchmarks.results import frame_of, keys_of
from core.lab.benchmarks.tables import candidates_table
from core.lab.datasets.srn import Dataset, index_objects, write_object
from core.lab.evaluation.protocol import ViewScore
from core.lab.training.recipes import TrainSettings
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.lab.training.test_trainer import SETTINGS
from tests.core.tiny import tiny_model

TWO_STEPS = Budget(None, 2)
QUICK = FitSettings(hypotheses=2, steps=4, rays=32, samples=8, free_steps=1, max_restarts=0)


def test_candidates_differ_in_width_bound_and_shares():
    chosen = candidates([30, 10, 60], regular=1, rays=64)
    assert list(chosen) == ["narrow", "wide", "bounded", "regular"]
    assert [settings.field.width for settings in chosen.values()] == [96, 128, 128, 128]
    assert all(settings.code_noise == (0.5, 0.1) for settings in chosen.values())
    assert [name for name, settings in chosen.items() if settings.code_bound] == ["bounded"]
    shares = dict(chosen["regular"].shares)
    assert shares[0.0] == pytest.approx((1 / 6, 0.5, 1 / 3))
    assert shares[1.0] == pytest.approx((1 / 3, 0.0, 2 / 3))
    assert "regular" not in candidates([30, 10], regular=None, rays=64)


def measure(
    folder: Path,
    chosen: dict[str, TrainSettings],
    done: Collection[tuple[str, bool, str, int]] = (),
    budget: Budget = TWO_STEPS,
    report: Callable[[str], object] = str,
) -> list[Judgement]:
    """Train on two stools and judge by a third."""
    model = tiny_model()
    dataset = Dataset((views_of(model, 0, 4), views_of(model, 1, 4)), "stools", model.image_size, model.focal)
    write_object(folder / "held out", views_of(model, 2, 4))
    cases = judged_cases(index_objects([folder / "held out"])[1], 1)
    with ThreadPoolExecutor(1) as pool:
        work = {"out": folder, "device": "cpu", "pool": pool, "report": report, "done": done}
        return list(measure_candidates(dataset, cases, chosen, budget, QUICK, **work))


def test_a_trained_candidate_is_judged_with_and_without_its_camera(tmp_path: Path):
    tiny_model().save(tmp_path / "plain.safetensors")
    written = (tmp_path / "plain.safetensors").stat().st_mtime_ns
    rows = measure(tmp_path, {"plain": SETTINGS})
    assert keys_of(frame_of(rows), KEY) == {("plain", True, "stool2", 1), ("plain", False, "stool2", 1)}
    for row in rows:
        assert row.rotation < 180 and row.novel.psnr > 5 and row.seconds > 0
        assert (row.confidence is None) == row.posed == (row.rotation < 1e-3)
    assert measure(tmp_path, {"plain": SETTINGS}, keys_of(frame_of(rows), KEY)) == []
    assert (tmp_path / "plain.safetensors").stat().st_mtime_ns == written
    table = candidates_table(frame_of(rows, {"machine": "a machine", "objects": "1"}))
    assert "| plain | unknown | 1 |" in table


@pytest.mark.parametrize("budget", [TWO_STEPS, Budget(1e-6, 2)])  # a time ends after the pace is known
def test_a_failed_candidate_is_named_and_the_others_continue(tmp_path: Path, budget: Budget):
    """After two steps the second candidate shows no object, so it cannot be judged; its model is saved."""
    lines = list[str]()
    chosen = {"wild": replace(SETTINGS, code_noise=(math.inf, 0.0)), "empty": SETTINGS}
    with pytest.raises(ValueError, match=r"wild: training diverged at step 1\b.*; empty: the model shows"):
        measure(tmp_path, chosen, budget=budget, report=lines.append)
    steps = 2 if budget is TWO_STEPS else 70  # the pace is first known after 70
    assert lines[1].startswith(f"empty: {steps} steps in ")
    assert [path.name for path in tmp_path.glob("*.safetensors")] == ["empty.safetensors"]


def test_the_table_compares_with_the_shipped_model_on_the_same_views():
    def row(candidate: str, name: str, db: float) -> Judgement:
        score = ViewScore(db, 0.9, 0.8, 0.1)
        return Judgement(candidate, True, name, 1, 0.0, score, score, None, 2.0)

    rows = row(SHIPPED, "a", 20.0), row(SHIPPED, "b", 30.0), row("wide", "a", 21.5)
    table = candidates_table(frame_of(rows, {"machine": "a machine", "objects": "2"}))
    assert "+1.50 (+1.50 to +1.50)" in table.splitlines()[-1]
