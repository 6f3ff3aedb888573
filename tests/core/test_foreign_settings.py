"""Fits and renders are the same in any process, thread or setting of the caller's, which are as before afterwards."""

import multiprocessing
import pickle
import random
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

import core
from core.fitting.settings import FitSettings
from core.models.model import Model
from core.photos.grabcut import grabcut
from core.runtime.precision import matmul_dtype, use_dtype
from core.runtime.threads import VARIABLE
from tests.conftest import unchecked_shapes

HASTY = FitSettings(hypotheses=4, steps=4, rays=64, samples=16, free_steps=1, max_restarts=0)
LONG = 300.0  # s after which a process hangs


class Outcome(NamedTuple):
    """All numbers of a fit and a render."""

    shape: list[float]
    texture: list[float]
    image: list[int]


class Job(NamedTuple):
    """A photo's fit and the render of its result, in a number format."""

    model: Model
    photo: Path
    dtype: torch.dtype

    def __call__(self) -> Outcome:
        with use_dtype(self.dtype), unchecked_shapes():
            instance = core.fit(self.model, self.photo, settings=HASTY)
            image = core.render(instance, core.camera_of(instance, 24))
            return Outcome(instance.codes.shape.tolist(), instance.codes.texture.tolist(), image.flatten().tolist())


class Outcomes(Dataset[Outcome]):
    """A data set that fits."""

    def __init__(self, job: Job) -> None:
        self.job = job

    def __len__(self) -> int:
        return 2

    def __getitem__(self, index: int) -> Outcome:
        return self.job()


def in_process(method: str, job: Job) -> Outcome:
    with ProcessPoolExecutor(1, multiprocessing.get_context(method)) as processes:
        result = processes.submit(job)
        try:
            return result.result(LONG)
        except TimeoutError:
            for process in processes._processes.values():
                process.kill()
            raise


def in_thread(job: Job) -> Outcome:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(job).result()


def in_loader(job: Job) -> Outcome:
    outcomes = [*DataLoader(Outcomes(job), batch_size=None, num_workers=2, timeout=LONG)]
    assert outcomes[0] == outcomes[1]
    return Outcome(*outcomes[0])


def pickled(job: Job) -> Outcome:
    return pickle.loads(pickle.dumps(job))()


def inside(context: Callable[[], AbstractContextManager[Any]], job: Job) -> Outcome:
    with context():
        before = settings()
        outcome = job()
        assert settings() == before
    return outcome


def settings() -> dict[str, object]:
    """All that belongs to the caller."""
    return {
        "dtype": torch.get_default_dtype(),
        "device": torch.get_default_device(),
        "modes": (torch.is_inference_mode_enabled(), torch.is_grad_enabled(), torch.is_autocast_enabled("cpu")),
        "threads": torch.get_num_threads(),
        "products": torch.get_float32_matmul_precision(),
        "numpy": str(np.geterr()),
        "filters": list(warnings.filters),
        "Pillow": Image.MAX_IMAGE_PIXELS,
        "random numbers": (random.getstate(), str(np.random.get_state()), torch.get_rng_state().tolist()),
    }


@contextmanager
def setting(change: Callable[[Any], object], value: Any, usual: Any) -> Iterator[None]:
    change(value)
    try:
        yield
    finally:
        change(usual)


@contextmanager
def warnings_as_errors() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def set_pillows_limit(pixels: int | None) -> None:
    Image.MAX_IMAGE_PIXELS = pixels


CONTEXTS: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "float64": partial(setting, torch.set_default_dtype, torch.float64, torch.float32),
    "bfloat16": partial(setting, torch.set_default_dtype, torch.bfloat16, torch.float32),
    "autocast": partial(torch.autocast, "cpu", torch.bfloat16),
    "inference mode": torch.inference_mode,
    "no gradients": torch.no_grad,
    "default device": partial(setting, torch.set_default_device, "meta", None),
    "device of a block": partial(torch.device, "meta"),
    "threads": partial(setting, torch.set_num_threads, 3, 1),
    "coarse products": partial(setting, torch.set_float32_matmul_precision, "medium", "highest"),
    "deterministic": partial(setting, torch.use_deterministic_algorithms, True, False),
    "anomalies": torch.autograd.detect_anomaly,
    "NumPy's errors": partial(np.errstate, all="raise"),
    "warnings as errors": warnings_as_errors,
    "Pillow's limit": partial(setting, set_pillows_limit, 5000, Image.MAX_IMAGE_PIXELS),
}
FOREIGN: dict[str, Callable[[Job], Outcome]] = {
    "fork": partial(in_process, "fork"),
    "spawn": partial(in_process, "spawn"),
    "thread": in_thread,
    "loader": in_loader,
    "pickle": pickled,
} | {name: partial(inside, context) for name, context in CONTEXTS.items()}


@pytest.fixture(scope="module")
def job(tiny: Model, tmp_path_factory: pytest.TempPathFactory) -> Job:
    path = tmp_path_factory.mktemp("photo") / "stool.png"
    Image.fromarray(core.render(tiny[1], tiny.camera(0.5, 0.5).resized(80, 80))).save(path)
    return Job(tiny, path, matmul_dtype("cpu"))


@pytest.fixture(scope="module", autouse=True)
def _two_threads() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, "2")
        yield


@pytest.fixture(scope="module")
def expected(job: Job) -> Outcome:
    return job()


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded", "ignore:Anomaly Detection")
def test_fits_and_renders_are_equal_in_foreign_settings(name: str, job: Job, expected: Outcome) -> None:
    assert FOREIGN[name](job) == expected
    assert job() == expected  # nothing of a foreign setting was cached


def test_threads_inside_one_setting_give_it_back_together(job: Job, expected: Outcome) -> None:
    with CONTEXTS["float64"](), ThreadPoolExecutor(3) as threads:
        outcomes = [threads.submit(job) for _ in range(6)]
        assert [outcome.result() for outcome in outcomes] == [expected] * 6
        assert torch.get_default_dtype() == torch.float64


def test_generators_leave_the_settings_to_the_caller_between_steps(job: Job) -> None:
    from core.fitting.fit import FitJob, fit
    from core.photos.photo import load_photo

    with CONTEXTS["float64"](), torch.inference_mode():
        photo = load_photo(job.photo, job.model)
        steps = fit(job.model, FitJob((photo,), HASTY))
        next(steps)
        assert torch.get_default_dtype() == torch.float64 and torch.is_inference_mode_enabled()
        steps.close()
        assert torch.get_default_dtype() == torch.float64 and torch.is_inference_mode_enabled()


def test_a_model_that_is_read_draws_no_random_numbers_of_the_caller() -> None:
    before = torch.get_rng_state()
    core.load_model("chairs")
    assert torch.equal(torch.get_rng_state(), before)


def test_grabcut_leaves_the_random_numbers_of_opencv() -> None:
    def drawn() -> Tensor:
        return torch.from_numpy(cv2.randu(np.zeros(8, np.uint8), 0, 255))

    image = Image.fromarray(np.random.default_rng(0).integers(0, 256, (40, 40, 3), np.uint8))
    labels = np.full((40, 40), cv2.GC_BGD, np.uint8)
    labels[10:30, 10:30] = cv2.GC_PR_FGD
    cv2.setRNGSeed(5)
    expected = drawn()
    cv2.setRNGSeed(5)
    first = grabcut(image, labels, (0, 0, 40, 40))
    assert torch.equal(drawn(), expected)
    assert np.array_equal(grabcut(image, labels, (0, 0, 40, 40)), first)


def test_objects_of_a_shipped_model_travel_without_it_and_are_equal_elsewhere(tmp_path: Path) -> None:
    chair = core.load_model("chairs")[3]
    hash(chair)
    data = pickle.dumps(chair)
    assert len(data) < 5000
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as processes:
        assert processes.submit(is_chair, data).result()


def is_chair(data: bytes) -> bool:
    chair = core.load_model("chairs")[3]
    return pickle.loads(data) == chair and pickle.loads(data) in {chair}


def test_changed_models_and_missing_ones_travel_whole(tiny: Model) -> None:
    from dataclasses import replace

    from core.models.missing import MissingInstance

    chairs = core.load_model("chairs")
    for instance in (tiny[1], chairs.soft[3], replace(chairs, metres=2.0)[3]):
        again = pickle.loads(pickle.dumps(instance))
        assert again == instance and again.model.metres == instance.model.metres
    missing = MissingInstance("0123", tiny[1].codes)
    assert pickle.loads(pickle.dumps(missing)) == missing


def test_a_thread_that_cannot_start_leaves_the_work_to_the_caller(
    job: Job, expected: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = threading.Thread.start

    def limited(thread: threading.Thread) -> None:
        if thread.name.startswith("pool_1"):
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", limited)
    monkeypatch.setenv(VARIABLE, "4")
    assert job() == expected
