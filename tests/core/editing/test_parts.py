"""Parts of a stool's image, by a head that is made to tell halves of its features apart."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import Frame
from core.editing import parts as module
from core.editing.parts import part_map
from core.geometry.camera import Camera
from core.models.model import Instance, Model
from core.models.part_head import PartHead
from tests.conftest import random_model


@pytest.fixture
def camera(tiny: Model) -> Camera:
    return tiny.camera(1.5708, 0.0).resized(96, 64)


def _frame(opacity: np.ndarray, distance: float = 2.0) -> Frame:
    image = np.zeros((*opacity.shape, 3), np.uint8)
    return Frame(image, np.full(opacity.shape, distance, np.float32), opacity.astype(np.float32), 0, 1, 64, 0.0)


def _with_head(model: Model, *names: str) -> Instance:
    width = model.field.config.width
    return replace(model, part_head=PartHead(names, torch.zeros(len(names), width), torch.zeros(len(names))))[0]


def _chair() -> np.ndarray:
    """A back above a seat above two legs, as probabilities of seat, back, legs and arms in 64 rows of 96 columns."""
    probabilities = np.zeros((4, 64, 96), np.float32)
    probabilities[1, 4:30, 30:60] = 1.0
    probabilities[0, 30:40, 20:70] = 1.0
    probabilities[2, 40:60, 20:26] = probabilities[2, 40:60, 64:70] = 1.0
    probabilities[2, 10:13, 40:43] = 1.0  # a mistake of the head in the middle of the back
    probabilities[1, 10:13, 40:43] = 0.0
    return probabilities


def test_every_part_lies_where_it_is_and_has_a_handle_at_the_object_s_edge(
    tiny: Model, camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    probabilities = _chair()
    opacity = probabilities.sum(0)
    monkeypatch.setattr(module, "_probabilities", lambda instance, points: probabilities[:, opacity > 0].T)
    instance = _with_head(tiny, "seat", "back", "legs", "arms")
    part_regions = part_map(instance, camera, _frame(opacity))
    assert sorted(handle.part for handle in part_regions.handles) == ["back", "legs", "legs", "seat"]
    areas = {handle.part: part_regions.mask(handle.part).sum() for handle in part_regions.handles}
    assert areas == pytest.approx({"seat": 500, "back": 780, "legs": 240}, rel=0.05)
    for handle in part_regions.handles:
        assert part_regions.handle_at(handle.place) is handle
    by_part = {handle.part: handle for handle in part_regions.handles}
    assert by_part["back"].place[1] < 8 / 64  # away from the seat
    assert by_part["legs"].place[1] > 55 / 64
    assert not 0.3 < by_part["seat"].place[0] < 0.6
    assert all(handle.is_outer for handle in part_regions.handles)
    assert by_part["back"].point[2] > by_part["legs"].point[2] + 0.2
    assert part_regions.handle_at((0.05, 0.5)) is None
    assert part_regions.handle_at((1.2, 0.5)) is None


def test_only_what_is_on_screen_has_handles(tiny: Model, camera: Camera) -> None:
    opacity = np.zeros((64, 96))
    opacity[10:54, 20:80] = 1.0
    part_regions = part_map(tiny[0], camera, _frame(opacity), (0.5, 0.0, 1.0, 1.0))
    (handle,) = part_regions.handles
    assert handle.part == "stool"
    assert handle.place[0] > 0.5 and abs(handle.place[1] - 0.5) > 0.25  # a drag in the middle turns the object
    assert part_regions.handle_at((0.4, 0.5)) is None


def test_a_part_within_the_middle_of_the_object_has_no_outer_handle(
    tiny: Model, camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    probabilities = np.zeros((2, 64, 96), np.float32)
    probabilities[0, 4:60, 20:76] = 1.0
    probabilities[0, 25:39, 41:55] = 0.0
    probabilities[1, 25:39, 41:55] = 1.0
    opacity = probabilities.sum(0)
    monkeypatch.setattr(module, "_probabilities", lambda instance, points: probabilities[:, opacity > 0].T)
    part_regions = part_map(_with_head(tiny, "body", "seat"), camera, _frame(opacity))
    assert {handle.part: handle.is_outer for handle in part_regions.handles} == {"body": True, "seat": False}


def test_no_part_of_a_chair_is_far_from_its_place(tiny: Model) -> None:
    instance = _with_head(tiny, "seat", "legs", "back", "arms")
    heights = torch.tensor([0.0, 0.0, 0.0, 0.3, -0.25])
    points = torch.stack((torch.zeros(5), torch.zeros(5), heights), -1)
    probabilities = module._probabilities(instance, points)
    assert (probabilities[3] > 0).tolist() == [False, False, True, True]
    assert (probabilities[4] > 0).tolist() == [True, True, False, True]


def test_an_empty_image_and_a_network_that_paints_the_background_have_no_parts(tiny: Model, camera: Camera) -> None:
    assert part_map(tiny[0], camera, _frame(np.zeros((64, 96)))).handles == ()
    authors = random_model(white_from_network=True)[0]
    assert part_map(authors, camera, _frame(np.ones((64, 96)))).handles == ()
