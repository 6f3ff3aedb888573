"""Results come in the order of the pieces, and any number of threads gives the same bits."""

import os
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from itertools import chain

import pytest
import torch
from torch import Tensor

from core.export.mesh import extract_mesh
from core.fitting.fit import FitJob, fit
from core.gl.baking import bake
from core.models.model import Model
from core.photos.view_bank import view_bank
from core.rendering import fast
from core.rendering.reference import render_exact
from core.runtime.pool import at_pause, map_pieces
from core.runtime.threads import VARIABLE
from core.streams import run_to_end
from tests.core.fitting.inputs import SHORT
from tests.core.tiny import photo_of


def thread(piece: object) -> int:
    return threading.get_ident()


@pytest.mark.parametrize("count", ["1", "2"])
def test_the_calling_thread_pauses_after_every_piece(monkeypatch: pytest.MonkeyPatch, count: str):
    monkeypatch.setenv(VARIABLE, count)
    pauses: list[int] = []
    at_pause(lambda: pauses.append(threading.get_ident()))
    try:
        assert list(map_pieces(str, range(5))) == [*"01234"]
    finally:
        at_pause(None)
    assert pauses == [threading.get_ident()] * 5


@pytest.mark.parametrize("count", ["1", "2", "8"])
def test_results_come_in_the_order_of_the_pieces(monkeypatch: pytest.MonkeyPatch, count: str):
    monkeypatch.setenv(VARIABLE, count)
    first = threading.Event()

    def late(piece: int) -> int:
        if piece or count == "1":
            first.set()
        else:
            first.wait()  # for another thread to take the next piece
        return piece

    assert list(map_pieces(late, range(50))) == list(range(50))
    assert list(map_pieces(late, [])) == []


def test_one_thread_and_nested_calls_compute_in_the_calling_thread(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "1")
    assert set(map_pieces(thread, range(9))) == {threading.get_ident()}
    monkeypatch.setenv(VARIABLE, "2")
    for outer, *inner in map_pieces(lambda _: (thread(0), *map_pieces(thread, range(3))), range(4)):
        assert set(inner) == {outer} != {threading.get_ident()}


@pytest.mark.parametrize("count", ["1", "2"])
def test_an_error_is_raised_in_the_place_of_its_piece(monkeypatch: pytest.MonkeyPatch, count: str):
    monkeypatch.setenv(VARIABLE, count)
    stream = map_pieces(lambda piece: 1 // piece, [1, 0, 1])
    assert next(stream) == 1
    with pytest.raises(ZeroDivisionError):
        next(stream)
    assert list(stream) == []


def test_a_closed_stream_starts_no_more_pieces(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "2")
    begun = list[int]()
    stream = map_pieces(begun.append, range(1000))
    next(stream)
    stream.close()
    count = len(begun)
    assert count < 10
    assert list(map_pieces(thread, range(4)))  # behind whatever were left
    assert len(begun) == count


def test_modes_of_the_caller_hold_in_the_threads(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "2")

    def modes(_: int) -> tuple[bool, bool, bool]:
        return torch.is_inference_mode_enabled(), torch.is_grad_enabled(), torch.is_autocast_enabled("cpu")

    assert list(map_pieces(modes, range(2))) == [(False, True, False)] * 2
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        assert list(map_pieces(modes, range(2))) == [(False, False, True)] * 2
    with torch.inference_mode():
        assert list(map_pieces(modes, range(2))) == [(True, False, False)] * 2
    assert list(map_pieces(lambda _: torch.get_num_threads(), range(2))) == [1, 1]


@pytest.mark.skipif(sys.platform != "linux", reason="threads have a priority of their own on Linux only")
def test_threads_have_the_priority_of_their_caller(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(VARIABLE, "2")
    priorities = list[int]()

    def priority(piece: object) -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def call() -> None:
        os.nice(3)
        priorities.extend((priority(0), *map_pieces(priority, range(4))))

    caller = threading.Thread(target=call)
    caller.start()
    caller.join()
    assert set(priorities) == {priorities[0]}


def equal_runs(*runs: list[Tensor]) -> bool:
    return all(torch.equal(expected, tensor) for run in runs for expected, tensor in zip(runs[0], run, strict=True))


def render_tensors(model: Model) -> list[Tensor]:
    fast.clear_cache()
    instance = model[1]
    camera = model.camera(0.5, 0.5).resized(90, 90)
    first = fast.render(instance, camera, 48)
    again = fast.render(instance.changed(texture=model.codes[2].texture), camera, 48)  # of the cached shape
    return [first.colour, first.depth, again.colour, render_exact(instance, camera, 32).colour]


def bake_tensors(model: Model) -> list[Tensor]:
    fast.clear_cache()
    return [torch.from_numpy(baked.texels) for baked in bake(model[1]) if baked]


def mesh_tensors(model: Model) -> list[Tensor]:
    mesh = run_to_end(extract_mesh(model[1], 48))
    return [torch.from_numpy(values) for values in (mesh.vertices, mesh.faces, mesh.colours)]


def fit_tensors(model: Model) -> list[Tensor]:
    photos = (photo_of(model[1], model.camera(0.5, 0.5)),)
    *_, last = fit(model, FitJob(photos, SHORT))
    cameras = chain.from_iterable((camera.azimuth, camera.elevation, camera.distance) for camera in last.cameras)
    codes = last.instance.codes
    return [codes.shape, codes.texture, torch.tensor([*cameras, last.loss], dtype=torch.double)]


def bank_tensors(model: Model) -> list[Tensor]:
    bank = view_bank(replace(model))  # a model that has none yet
    return [bank.silhouettes, bank.sizes, bank.offsets]


@pytest.mark.parametrize("job", [render_tensors, bake_tensors, mesh_tensors, fit_tensors, bank_tensors])
def test_threads_give_the_same_bits(tiny: Model, job: Callable[[Model], list[Tensor]], monkeypatch: pytest.MonkeyPatch):
    runs = []
    for count in ("1", "2", "8"):
        monkeypatch.setenv(VARIABLE, count)
        runs.append(job(tiny))
    assert equal_runs(*runs)
