"""Paint of a tiny model and of shipped models with parts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import render_frame
from core.editing.paint import Paint, coarse_paint, paint, paint_colour, paint_parts
from core.editing.parts import part_map
from core.edits.paint import PartPaint
from core.models.library import load_model
from core.models.model import Instance, Model
from core.streams import run_to_end


@pytest.fixture(scope="module")
def cars() -> Model:
    return load_model("cars")


_UNPAINTED = "wheels", "glass"


def colour(instance: Instance, name: str = "") -> torch.Tensor:
    """The paint of a part."""
    return torch.tensor(run_to_end(paint_colour(instance, name)))


def difference(first: torch.Tensor, second: torch.Tensor) -> float:
    """The largest difference of a channel, 0..1."""
    return float((first - second).abs().max())


RED = (0.75, 0.19, 0.16)
BLUE = (0.2, 0.35, 0.65)


def painted(instance: Instance, colour: tuple[float, float, float], name: str = "") -> Instance:
    """The object with a paint on a part."""
    return run_to_end(paint(instance, Paint(colour, name)))


def test_a_paint_is_reached_and_the_same_paint_changes_nothing(tiny: Model) -> None:
    instance = tiny[0]
    assert painted(instance, run_to_end(paint_colour(instance))) == instance
    red = painted(instance, RED)
    assert difference(colour(red), torch.tensor(RED)) < 0.02
    assert painted(red, RED) == red
    assert red.with_texture(instance) == instance


def test_a_coarse_paint_colours_the_body_in_a_frame_and_leaves_its_glass_and_wheels(cars: Model) -> None:
    instance = cars[cars.codes.valid[0]]
    camera = cars.camera(1.0, 0.3).resized(96, 96)
    frame = render_frame(instance, camera)
    body, *unpainted = (coarse_paint(instance, camera, frame, name) for name in ("body", *_UNPAINTED))
    assert body.fraction.sum() > 1.2 * sum(coarse.fraction.sum() for coarse in unpainted)
    assert (body.fraction[frame.opacity == 0] == 0).all()
    assert np.array_equal(body.repainted(body.colour), frame.image)
    painted = body.repainted((0.9, 0.1, 0.1)).astype(int)[body.fraction > 0.7]
    assert (painted[:, 0] - painted[:, 1]).mean() > 100


def test_nothing_has_paint_in_a_frame_without_an_object(tiny: Model) -> None:
    camera = tiny.camera(0.0, 0.0).resized(8, 8)
    frame = replace(render_frame(tiny[0], camera), opacity=np.zeros((8, 8), np.float32))
    assert not coarse_paint(tiny[0], camera, frame).fraction.any()


@pytest.mark.parametrize("name", ["seat", "back", "legs", "fabric"])
def test_a_part_takes_any_colour_in_place_of_its_former_one(name: str) -> None:
    instance = load_model("chairs")[2]
    blue = painted(instance, BLUE, name)
    assert difference(colour(blue, name), torch.tensor(BLUE)) < 0.02
    assert painted(painted(instance, RED, name), BLUE, name) == blue
    assert torch.equal(blue.codes.texture, instance.codes.texture)


def test_a_cars_body_is_painted_and_its_glass_and_wheels_are_not(cars: Model) -> None:
    instance = cars[cars.codes.valid[0]]
    red = painted(instance, RED)
    assert difference(colour(red), torch.tensor(RED)) < 0.02
    body, *unpainted = (difference(colour(red, name), colour(instance, name)) for name in ("body", *_UNPAINTED))
    assert body > 3 * max(unpainted)


@pytest.mark.parametrize(("material", "its_part", "other_part"), [("fabric", "seat", "legs"), ("wood", "legs", "seat")])
def test_painting_a_material_of_a_chair_keeps_the_other(material: str, its_part: str, other_part: str) -> None:
    instance = _two_coloured(load_model("chairs"))
    blue = painted(instance, BLUE, material)
    change, other_change = (difference(colour(blue, name), colour(instance, name)) for name in (its_part, other_part))
    assert change > 3 * other_change


def _two_coloured(chairs: Model) -> Instance:
    """The chair, of every hundredth trained one, whose seat and legs differ most in colour."""
    instances = [chairs[index] for index in chairs.codes.valid[::100]]
    return max(instances, key=lambda chair: float((colour(chair, "seat") - colour(chair, "legs")).norm()))


def test_the_usual_part_is_the_largest() -> None:
    instance = load_model("chairs")[2]
    assert painted(instance, RED).codes.of_kind(PartPaint)[0].part in ("seat", "back")
    camera = instance.model.camera(1.0, 0.3).resized(96, 96)
    visible = part_map(instance, camera, render_frame(instance, camera)).largest(paint_parts(instance.model))
    assert visible in ("seat", "back")  # of one view, not of the whole surface


def test_paintable_parts_are_named_and_bad_input_is_refused(tiny: Model, cars: Model) -> None:
    with pytest.raises(ValueError, match="three channels"):
        Paint((0.1, 0.2, 1.5))
    with pytest.raises(ValueError, match="a car has body, but no seat"):
        run_to_end(paint(cars[0], Paint((0.1, 0.2, 0.3), "seat")))
    with pytest.raises(ValueError, match="has no parts"):
        run_to_end(paint(tiny[0], Paint((0.1, 0.2, 0.3), "seat")))
    assert paint_parts(tiny) == ()
    assert paint_parts(cars) == ("body",)
    assert {"fabric", "wood", "seat", "legs"} < set(paint_parts(load_model("chairs")))
