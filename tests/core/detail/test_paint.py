"""On a tiny model: its textures are a few colours, and a paint is one between them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.paint import Paint, coarse_paint, paint, paint_colour, paint_parts
from core.detail.progressive import render_frame
from core.models.library import load_model
from core.models.model import Instance, Model
from core.streams import run_to_end


@pytest.fixture(scope="module")
def cars() -> Model:
    return load_model("cars")


_KEPT = "wheels", "glass"


def colour(model: Model, instance: Instance, part: str = "") -> torch.Tensor:
    return torch.tensor(run_to_end(paint_colour(instance, part)))


def test_its_own_paint_changes_nothing_and_anothers_is_reached_with_the_shape_kept(tiny: Model) -> None:
    instance = tiny[0]
    assert run_to_end(paint(instance, Paint(run_to_end(paint_colour(instance))))) == instance
    instance, goal = tiny[0], run_to_end(paint_colour(tiny[0].changed(texture=tiny.codes[3].texture)))
    found = run_to_end(paint(instance, Paint(goal)))
    before, after = (float((colour(tiny, one) - torch.tensor(goal)).abs().max()) for one in (instance, found))
    assert after < min(0.03, before)
    assert torch.equal(found.codes.shape, instance.codes.shape)


def test_a_cars_body_is_painted_and_its_glass_and_wheels_are_not(cars: Model) -> None:
    instance = cars[cars.codes.valid[0]]
    red = Paint((0.75, 0.19, 0.16))
    painted = run_to_end(paint(instance, red))
    assert (colour(cars, painted) - torch.tensor(red.colour)).abs().max() < 0.08
    moved = [
        float((colour(cars, painted, part) - colour(cars, instance, part)).abs().max()) for part in ("body", *_KEPT)
    ]
    assert moved[0] > 3 * max(moved[1:])
    assert (render_frame(painted, cars.camera(1.0, 0.3)).image != 255).any()


def test_a_coarse_paint_colours_the_body_in_a_frame_and_leaves_its_glass_and_wheels(cars: Model) -> None:
    instance, camera = cars[cars.codes.valid[0]], cars.camera(1.0, 0.3).resized(96, 96)
    frame = render_frame(instance, camera)
    body, *kept = (coarse_paint(instance, camera, frame, part) for part in ("body", *_KEPT))
    assert body.fraction.sum() > 1.2 * sum(part.fraction.sum() for part in kept)
    assert (body.fraction[frame.opacity == 0] == 0).all()
    own, red = body.repainted(body.colour), body.repainted((0.9, 0.1, 0.1)).astype(int)
    assert np.array_equal(own, frame.image)
    painted = red[body.fraction > 0.7]
    assert (painted[:, 0] - painted[:, 1]).mean() > 100


def test_nothing_has_paint_in_a_frame_without_an_object(tiny: Model) -> None:
    camera = tiny.camera(0.0, 0.0).resized(8, 8)
    frame = replace(render_frame(tiny[0], camera), opacity=np.zeros((8, 8), np.float32))
    assert not coarse_paint(tiny[0], camera, frame).fraction.any()


@pytest.mark.parametrize("material, other", [("fabric", "wood"), ("wood", "fabric")])
def test_of_a_chair_one_material_is_painted(material: str, other: str) -> None:
    chairs = load_model("chairs")
    instance = _two_coloured(chairs)
    painted = run_to_end(paint(instance, Paint((0.2, 0.35, 0.65), material)))
    seed, kept = ({"fabric": "seat", "wood": "legs"}[one] for one in (material, other))
    moved, stayed = ((colour(chairs, painted, one) - colour(chairs, instance, one)).abs().max() for one in (seed, kept))
    assert moved > 3 * stayed


def _two_coloured(chairs: Model) -> Instance:
    """The trained chair whose seat and legs differ most in colour, of some."""
    some = [chairs[index] for index in chairs.codes.valid[::100]]
    return max(some, key=lambda one: float((colour(chairs, one, "seat") - colour(chairs, one, "legs")).norm()))


def test_parts_take_paint_the_usual_one_first_and_bad_input_is_refused(tiny: Model, cars: Model) -> None:
    with pytest.raises(ValueError, match="three channels"):
        Paint((0.1, 0.2, 1.5))
    with pytest.raises(ValueError, match="a car has body, but no seat"):
        run_to_end(paint(cars[0], Paint((0.1, 0.2, 0.3), "seat")))
    with pytest.raises(ValueError, match="has no parts"):
        run_to_end(paint(tiny[0], Paint((0.1, 0.2, 0.3), "seat")))
    assert paint_parts(tiny) == ()
    assert paint_parts(cars) == ("body",)
    assert paint_parts(load_model("chairs"))[:3] == ("fabric", "wood", "seat")
