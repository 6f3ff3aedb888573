"""Paints of parts, of a tiny model with a part head."""

import json
import math
from dataclasses import replace

import pytest
import torch

from core.edits import kinds
from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.models.codes import Codes
from core.models.model import Instance, Model
from core.models.part_head import PartHead
from core.models.scene import Scene
from core.rendering.images import render_steps
from core.rendering.reference import render_exact
from core.streams import run_to_end

RED = PartPaint("seat", (0.8, 0.1, 0.1), (0.5, 0.5, 0.4))
BLUE = PartPaint("seat", (0.1, 0.2, 0.8), (0.5, 0.5, 0.4))
LEGS = PartPaint("legs", (0.9, 0.9, 0.9), (0.3, 0.2, 0.1))


@pytest.fixture
def chair(tiny: Model) -> Instance:
    """An object whose points are of a part according to the features of the density."""
    weight = torch.randn(2, tiny.field.config.width, generator=torch.Generator().manual_seed(1))
    return replace(tiny, part_head=PartHead(("seat", "legs"), 3 * weight, torch.zeros(2)))[0]


def test_all_renderers_show_the_same_paints(chair: Instance) -> None:
    camera = chair.model.camera(0.7, 0.3).resized(24, 24)
    red = chair.with_edits(PartPaint, RED, LEGS)
    exact = render_exact(red, camera)
    fast = run_to_end(render_steps(red, camera, 256))
    assert (exact.colour - fast.colour).abs().mean() < 0.01
    assert (exact.colour - render_exact(red.unpainted, camera).colour).abs().max() > 0.2
    assert torch.equal(exact.opacity, render_exact(red.unpainted, camera).opacity)


def test_a_paint_leaves_places_of_other_parts_exactly_as_they_were(chair: Instance) -> None:
    generator = torch.Generator().manual_seed(0)
    colours = torch.rand(99, 3, generator=generator)
    activations = torch.randn(99, chair.model.field.config.width, generator=generator)
    head = chair.model.part_head
    head = replace(head, weight=1000 * head.weight)  # certain everywhere
    probabilities = head.parts(activations)
    membership = probabilities["seat"]
    painted = kinds.colours(colours, (RED,), lambda: probabilities)
    assert torch.equal(painted[membership == 0], colours[membership == 0])
    assert not torch.isclose(painted[membership == 1], colours[membership == 1]).all(-1).any()
    assert torch.equal(kinds.colours(colours, (), lambda: probabilities), colours)
    assert torch.equal(kinds.colours(colours, (replace(RED, part="door"),), lambda: probabilities), colours)


def test_a_material_is_where_colours_are_nearer_to_its_own() -> None:
    fabric = PartPaint("fabric", (0.0, 0.0, 1.0), (1.0, 1.0, 1.0), ((1.0, 1.0, 1.0), (0.4, 0.2, 0.0)))
    membership = fabric.membership(torch.tensor([[1.0, 1.0, 1.0], [0.4, 0.2, 0.0], [0.7, 0.6, 0.5]]), {})
    assert membership.tolist() == pytest.approx([1, 0, 0.5])


def test_paints_belong_to_the_texture_and_stay_with_edits_of_the_shape(chair: Instance, tiny: Model) -> None:
    red = chair.with_edits(PartPaint, RED)
    second = chair.model[1]
    assert red != chair and red.codes.texture_key != chair.codes.texture_key
    assert red.codes.shape_key == chair.codes.shape_key
    assert second.with_texture(red).codes.edits == (RED,) == red.with_shape(second).codes.edits
    assert red.with_texture(chair) == chair
    tall = red.with_edits(Stretch, Stretch((1.0, 1.0, 1.2))).moved("shape", torch.ones_like(chair.codes.shape))
    assert tall.codes.of_kind(PartPaint) == (RED,)


def test_a_mix_passes_from_paint_to_paint() -> None:
    assert PartPaint.mixed((RED,), (BLUE,), 0.0) == (RED,) and PartPaint.mixed((RED,), (BLUE,), 1.0) == (BLUE,)
    assert PartPaint.mixed((RED,), (RED,), 0.3) == (RED,)
    assert [paint.share for paint in PartPaint.mixed((RED, LEGS), (BLUE,), 0.25)] == [1.0, 0.75, 0.25]
    faint = PartPaint.mixed((RED,), (replace(BLUE, share=0.5),), 0.999)
    assert faint[0].share < 0.01 and faint[1].share == pytest.approx(0.5, abs=1e-3)
    assert len(PartPaint.mixed((RED,) * PartPaint.most, (BLUE,) * PartPaint.most, 0.5)) == PartPaint.most


def test_a_scene_file_holds_paints_and_one_without_them_opens(chair: Instance) -> None:
    legs = replace(LEGS, materials=(RED.before, LEGS.before), share=0.5)
    painted_chair = chair.with_edits(PartPaint, RED, legs)
    text = Scene(painted_chair, chair.model.camera(0.0, 0.0)).to_json()
    assert Scene.from_json(text, chair.model).instance == painted_chair
    record = json.loads(text)
    del record["paints"]
    assert Scene.from_json(json.dumps(record), chair.model).instance == chair


@pytest.mark.parametrize(
    "harm",
    [
        {"colour": (0.1, 0.2, 1.5)},
        {"before": (0.1, math.nan, 0.3)},
        {"share": -0.1},
        {"materials": (RED.before, RED.before)},
    ],
)
def test_a_paint_out_of_range_is_refused(harm: dict) -> None:
    with pytest.raises(ValueError, match=r"paint|materials"):
        replace(RED, **harm)


def test_an_object_has_a_limited_number_of_paints(chair: Instance) -> None:
    with pytest.raises(ValueError, match="at most"):
        Codes(chair.codes.shape, chair.codes.texture, edits=(RED,) * (PartPaint.most + 1))
