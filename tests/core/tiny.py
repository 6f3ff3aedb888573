"""A tiny model of a real thing: lopsided stools of four shapes and four colours.

:mod:`tests.core.train_tiny` wrote the file of its weights: trained weights differ between processors, by more than the
last digit.
"""

from functools import cache
from pathlib import Path

import torch
from safetensors.torch import load_file

from core.geometry.camera import Camera
from core.models.codes import CodeBook, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.model import Instance, Model
from core.models.view_bank import ViewBank
from core.photos.photo import Photo
from core.photos.view_bank import view_bank
from core.rendering.reference import render_exact

EXTENT = (0.4, 0.4, 0.4)
SIDE = 40
CONFIG = FieldConfig(32, 2, 1, 2, 2, position_frequencies=3, direction_frequencies=0)
WEIGHTS = Path(__file__).with_name("tiny.safetensors")


@cache
def tiny_model() -> Model:
    """Seat, back, one arm rest: no symmetry. The first code makes it taller, the second wider; two more its hue."""
    field = Field(CONFIG)
    field.load_state_dict(load_file(WEIGHTS))
    corners = torch.tensor([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    objects = tuple(Entry(f"stool{i}", i, (i * 3 + 1) % 4) for i in range(4))
    return Model(field, CodeBook(corners, corners.clone(), objects), EXTENT, "stools", SIDE, 60.0, 2.0)


def tiny_bank() -> ViewBank:
    """The view bank of the tiny model."""
    return view_bank(tiny_model())


def photo_of(instance: Instance, camera: Camera) -> Photo:
    """An image of one of a model's objects, with its mask."""
    frame = render_exact(instance, camera, 64)
    return Photo(frame.colour.clamp(0, 1), frame.opacity > 0.5)
