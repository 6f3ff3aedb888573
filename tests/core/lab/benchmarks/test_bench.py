from pathlib import Path
from types import SimpleNamespace

import pytest

from core.lab.benchmarks import bench, exports
from core.lab.benchmarks.bench import BENCHMARKS, Plan, plan_tasks, run
from core.lab.benchmarks.exports import ExportTrial
from core.lab.benchmarks.held_out_views import DATASETS, HeldOutView
from core.lab.benchmarks.results import read_frame
from core.lab.datasets.srn import write_object
from tests.core.lab.evaluation.test_protocol import views_of
from tests.core.tiny import tiny_model

CODE = {"commit": "a1", "processor": "p", "date": "2026-11-28"}
PLAN = Plan(DATASETS, ("exports",), objects=1, quick=True)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Measure instantly in this process; return the cases that were measured."""
    names = list[str]()

    def measure(view: HeldOutView, case: str) -> tuple[ExportTrial, ...]:
        names.append(case)
        return (ExportTrial(view.model.category, view.views.name, view.number, case, 1, 1.0, 2.0),)

    monkeypatch.setitem(BENCHMARKS, "exports", SimpleNamespace(cases=exports.cases, measure=measure))
    monkeypatch.setattr(bench, "thread_count", lambda: 1)
    return names


def test_views_come_before_objects_and_categories_alternate() -> None:
    tasks = plan_tasks(Plan(DATASETS, ("exports", "stability"), objects=2, views=2, quick=True))
    assert [task.number for task in tasks] == sorted(task.number for task in tasks)
    objects = list(dict.fromkeys((task.category, task.name) for task in tasks))
    assert [category for category, _ in objects] == ["chairs", "cars", "chairs", "cars"]
    assert {task.benchmark for task in tasks if task.number == 1} == {"stability"}
    assert len(set(tasks)) == len(tasks)


@pytest.mark.parametrize("benchmark", BENCHMARKS)
def test_quick_cases_are_a_part_of_all(benchmark: str) -> None:
    quick, usual = (BENCHMARKS[benchmark].cases(is_quick) for is_quick in (True, False))
    assert set(quick) < set(usual) or (benchmark == "disentanglement" and quick == usual)


def test_a_dataset_of_an_unknown_category_is_named(tmp_path: Path) -> None:
    write_object(tmp_path / "d", views_of(tiny_model(), 0, 2))
    with pytest.raises(ValueError, match="d: there is no model of its category ''"):
        plan_tasks(Plan((tmp_path / "d",)))


def test_a_run_goes_on_where_one_ended(tmp_path: Path, measured: list[str]) -> None:
    assert not run(PLAN._replace(minutes=0), tmp_path, CODE, str)
    assert measured == [] and not (tmp_path / "exports.csv").exists()
    assert run(PLAN, tmp_path, CODE, str)
    assert len(measured) == 2 * len(exports.cases(True))
    assert run(PLAN, tmp_path, CODE | {"date": "2026-11-29"}, str)
    assert len(measured) == 2 * len(exports.cases(True))
    assert set(read_frame(tmp_path / "exports.csv").date) == {CODE["date"]}


@pytest.mark.parametrize("condition", ["commit", "processor"])
def test_rows_by_other_code_are_measured_anew(tmp_path: Path, measured: list[str], condition: str) -> None:
    run(PLAN._replace(objects=1), tmp_path, CODE | {condition: "other"}, str)
    run(PLAN, tmp_path, CODE, str)
    assert set(read_frame(tmp_path / "exports.csv")[condition]) == {CODE[condition]}
    assert len(measured) == 4 * len(exports.cases(True))
