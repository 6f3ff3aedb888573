"""Offsets of biases and an object's own network are rendered, mixed, taken and stored with the object."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from core.export.mesh import extract_mesh
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from core.models.motion import moved_along
from core.models.network import copy_field, has_network, weight_offsets, with_network
from core.models.scene import Scene, save_image
from core.rendering.fast import clear_cache, render
from core.rendering.images import render_image
from core.rendering.occupancy import shape_occupancy
from core.rendering.reference import render_exact
from core.streams import run_to_end
from tests.core.baked_reference import render_baked
from tests.core.models.test_latents import freed

Make = Callable[[Model, int], Instance]


def owning(model: Model, index: int, scale: float = 0.02) -> Instance:
    """An object with free biases and a network of its own."""
    generator = torch.Generator().manual_seed(index)
    field = copy_field(model.field)
    with torch.no_grad():
        for weight in (*field.shape_weights, *field.texture_weights):
            weight += scale * torch.randn(weight.shape, generator=generator)
    biases = freed(model, index, 0.3).codes
    rows = zip((biases.shape_offsets, biases.texture_offsets), weight_offsets(field, model.field), strict=True)
    shape, texture = (torch.cat(pair) for pair in rows)
    return model[index].changed(shape_offsets=shape, texture_offsets=texture)


@pytest.mark.parametrize(
    ("make", "make_plain"),
    [(freed, Model.__getitem__), (owning, lambda model, index: freed(model, index, 0.3))],
    ids=["biases", "network"],
)
def test_every_renderer_shows_offsets(tiny: Model, make: Make, make_plain: Make):
    instance = make(tiny, 0)
    plain = make_plain(tiny, 0)
    camera = tiny.camera(0.7, 0.4)
    exact = render_exact(instance, camera)
    assert float((exact.colour - render_exact(plain, camera).colour).abs().mean()) > 0.01
    assert float((exact.colour - render_image(instance, camera).colour).abs().mean()) < 0.01
    *_, baked = (field for field in bake(instance) if field is not None)
    assert psnr(render_baked(baked, camera).colour, exact.colour) > 35
    mesh = run_to_end(extract_mesh(instance, 48))
    points = torch.from_numpy(mesh.vertices).float()
    spreads = []  # of the logarithm of densities on the mesh: small on an object's own
    for variant in (instance, plain):
        density, _ = with_network(tiny, variant.codes).field.density(points, variant.biases[0])
        spreads.append(float(density.clamp_min(1e-6).log().std()))
    assert spreads[0] < spreads[1]


def test_the_weights_are_the_category_s_plus_offsets_and_the_model_does_not_change(tiny: Model):
    fingerprint = tiny.fingerprint
    instance = owning(tiny, 0)
    model = with_network(tiny, instance.codes)
    rows = tiny.field.config.shape_blocks
    assert torch.equal(weight_offsets(model.field, tiny.field)[0], instance.codes.shape_offsets[rows:])
    assert with_network(tiny, instance.moved("shape", torch.ones(2)).codes) is model
    assert with_network(tiny, freed(tiny, 0).codes) is tiny and with_network(tiny, tiny[0].codes) is tiny
    assert model.field.point_layer is tiny.field.point_layer
    del vars(tiny)["fingerprint"]
    assert tiny.fingerprint == fingerprint


@pytest.mark.parametrize("make", [freed, owning])
def test_offsets_of_the_texture_leave_the_shape(tiny: Model, make: Make):
    camera = tiny.camera(0.4, 0.5)
    instance = make(tiny, 0)
    plain = instance.taking("texture", tiny[1])
    assert has_network(tiny, plain.codes) == (make is owning) and plain.codes.texture_offsets is None
    first, second = (render_exact(variant, camera) for variant in (instance, plain))
    assert torch.equal(first.opacity, second.opacity) and not torch.equal(first.colour, second.colour)


@pytest.mark.parametrize("second", [owning, freed, Model.__getitem__], ids=["network", "biases", "codes"])
def test_networks_are_mixed_as_codes_are(tiny: Model, second):
    start = owning(tiny, 0)
    end = second(tiny, 1)
    camera = tiny.camera(0.4, 0.5)
    for amount, instance in ((0.0, start), (1.0, end)):
        mixed = start.mixed(end, amount, amount)
        torch.testing.assert_close(render_exact(mixed, camera).colour, render_exact(instance, camera).colour)
    middle = start.mixed(end, 0.5, 0.5).codes.shape_offsets.float()
    opposite = end.mixed(start, 0.5, 0.5).codes.shape_offsets.float()
    torch.testing.assert_close(middle, opposite)
    rows = 0 if end.codes.shape_offsets is None else len(end.codes.shape_offsets)
    torch.testing.assert_close(middle[rows:], start.codes.shape_offsets[rows:].float() / 2, atol=1e-4, rtol=1e-2)


def test_previews_of_a_changing_mixture_show_its_network(tiny: Model):
    camera = tiny.camera(0.4, 0.5)
    for amount in (0.0, 0.02, 0.98, 1.0):
        mixed = tiny[0].mixed(owning(tiny, 0), amount, amount)
        preview = render(mixed, camera, 64, complete=False)
        assert float((preview.colour - render_exact(mixed, camera).colour).abs().mean()) < 0.01


def test_a_changing_shape_reuses_occupied_cells_although_the_texture_has_a_network(tiny: Model):
    clear_cache()
    instance = tiny[0].taking("texture", owning(tiny, 0))
    assert shape_occupancy(instance).complete
    assert not shape_occupancy(instance.moved("shape", torch.full((2,), 1e-3)), complete=False).complete


@pytest.mark.parametrize("make", [freed, owning])
def test_a_scene_keeps_offsets_in_a_file_and_in_an_image(tiny: Model, make: Make, tmp_path: Path):
    scene = Scene(make(tiny, 0), tiny.camera(0.4, 0.5))
    scene.save(tmp_path / "scene.json")
    save_image(np.zeros((8, 8, 3), np.uint8), tmp_path / "scene.png", scene)
    for name in ("scene.json", "scene.png"):
        assert Scene.load(tmp_path / name, tiny) == scene
    shorter = scene.instance.changed(shape_offsets=scene.instance.codes.shape_offsets[:-1])
    with pytest.raises(ValueError, match="another model"):
        Scene.from_json(Scene(shorter, scene.camera).to_json(), tiny)


def test_an_edit_of_the_shape_moves_the_surface_of_the_network(tiny: Model):
    instance = owning(tiny, 0)
    moved = moved_along(instance, 0, 2.0)
    assert moved != instance and moved.codes.shape_offsets is instance.codes.shape_offsets
    camera = tiny.camera(0.4, 0.5)
    exact = render_exact(moved, camera)
    assert float((exact.colour - render_image(moved, camera).colour).abs().mean()) < 0.01
    assert float((exact.colour - render_exact(instance, camera).colour).abs().mean()) > 1e-3
