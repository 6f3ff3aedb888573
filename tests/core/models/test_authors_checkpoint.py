import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from core.detail.progressive import render_frame
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.authors_checkpoint import load_authors
from core.models.codes import Codes
from core.models.library import load_model
from core.models.model import Instance, Model
from core.rendering.reference import Rendered, render_exact
from tests.core.models.authors_reference import FOCAL, GOLDEN, SAMPLES, SIDE, evaluate, read_weights, render


@pytest.fixture(scope="module")
def cars(shared: Path) -> Model:
    return load_authors(shared / "upstream/srncars500/models.pth")


@pytest.fixture(scope="module")
def converted(cars: Model, tmp_path_factory: pytest.TempPathFactory) -> Model:
    path = tmp_path_factory.mktemp("converted") / "cars.safetensors"
    cars.save(path)
    return Model.load(path)


def test_collapsed_codes_are_found_and_kept_in_the_converted_file(cars: Model, converted: Model):
    """196 is a mist too, which the shared data's list leaves out; no whole car is among them."""
    assert cars.codes.collapsed == {24, 142, 149, 185, 250, 329} | {196}
    assert len(cars.codes) == 500
    assert torch.equal(cars.codes[24].shape, cars.codes.shapes[24])
    sound = torch.tensor(cars.codes.valid)
    torch.testing.assert_close(cars.codes.mean.shape, cars.codes.shapes[sound].mean(0))
    torch.testing.assert_close(cars.codes.mean.texture, cars.codes.textures[sound].mean(0))
    assert converted.fingerprint == cars.fingerprint
    assert converted.codes.collapsed == cars.codes.collapsed
    assert converted.codes.mean == cars.codes.mean
    assert (converted.white_from_network, converted.category, converted.distance) == (True, "cars", 1.3)
    instance = converted[1]
    camera = converted.camera(0.7, 0.4).resized(64, 64)
    exact = render_exact(instance, camera, 96).colour.clamp(0, 1)
    fast = torch.from_numpy(render_frame(instance, camera).image).float() / 255
    assert psnr(fast, exact) > 45


def rendered(
    model: Model, expected: dict[str, np.ndarray], index: int, focal: float, side: int, samples: int
) -> Rendered:
    """Render the view and the codes of an expected image with the exact renderer."""
    camera = Camera.from_pose(torch.tensor(expected[f"pose_{index}"]), focal, side, side)
    shape, texture = (int(row) for row in expected[f"codes_{index}"])
    codes = Codes(model.codes.shapes[shape], model.codes.textures[texture])
    return render_exact(Instance(model, codes), camera, samples)


@pytest.mark.parametrize("index", [0, 3])
def test_the_converted_file_renders_the_authors_images(index: int, converted: Model, shared: Path):
    expected = dict(np.load(shared / "upstream/expected_64.npz"))
    image = rendered(converted, expected, index, 65.625, 64, 64)
    assert psnr(image.colour, torch.tensor(expected[f"rgb_{index}"])) > 60


@pytest.fixture(scope="module")
def golden() -> Model:
    return load_authors(GOLDEN / "models.pth")


@pytest.fixture(scope="module")
def golden_expected() -> dict[str, np.ndarray]:
    return dict(np.load(GOLDEN / "expected.npz"))


def test_the_plain_reference_renders_the_authors_image(shared: Path):
    network, shapes, textures = read_weights(shared / "upstream/srncars500/models.pth")
    expected = np.load(shared / "upstream/expected_64.npz")
    shape, texture = expected["point_codes"]
    points = expected["points"].astype(float)
    directions = expected["dirs"].astype(float)
    density, rgb = evaluate(network, points, directions, shapes[shape], textures[texture])
    np.testing.assert_allclose(density, expected["sigma"], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(rgb, expected["rgb"], atol=1e-5)
    shape, texture = expected["codes_0"]
    colour, depth = render(network, (shapes[shape], textures[texture]), expected["pose_0"], 65.625, 64, 64)
    np.testing.assert_allclose(colour, expected["rgb_0"], atol=1e-4)
    np.testing.assert_allclose(depth, expected["depth_0"], atol=1e-4)


@pytest.mark.parametrize("index", range(3))
def test_the_golden_images_are_those_of_the_plain_reference(index: int, golden_expected: dict[str, np.ndarray]):
    network, shapes, textures = read_weights(GOLDEN / "models.pth")
    shape, texture = golden_expected[f"codes_{index}"]
    pose = golden_expected[f"pose_{index}"]
    colour, depth = render(network, (shapes[shape], textures[texture]), pose, FOCAL, SIDE, SAMPLES)
    np.testing.assert_allclose(colour, golden_expected[f"rgb_{index}"], atol=1e-5)
    np.testing.assert_allclose(depth, golden_expected[f"depth_{index}"], atol=1e-5)


@pytest.mark.parametrize("index", range(3))
def test_the_renderer_is_the_authors(index: int, golden: Model, golden_expected: dict[str, np.ndarray]):
    """Colours and depths at every pixel: encoding, codes, rays, samples, the last interval and the white behind it."""
    image = rendered(golden, golden_expected, index, FOCAL, SIDE, SAMPLES)
    np.testing.assert_allclose(image.colour, golden_expected[f"rgb_{index}"], atol=1e-4)
    depth = image.depth * image.opacity
    np.testing.assert_allclose(depth, golden_expected[f"depth_{index}"], atol=1e-4)


class Trap:
    def __reduce__(self):
        return (Path.write_text, (Path("sprung"), "executed"))


def test_nothing_in_a_file_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "models.pth"
    settings = (GOLDEN / "hpam.json").read_text()
    (tmp_path / "hpam.json").write_text(settings)
    for writer in (torch.save, lambda value, to: to.write_bytes(pickle.dumps(value, 2))):
        writer({"model_params": Trap()}, path)
        with pytest.raises(ValueError, match=r"models\.pth: not a checkpoint .*something else than tensors") as error:
            load_authors(path)
        assert "trust" not in str(error.value)  # torch's advice
    assert not (tmp_path / "sprung").exists()


def settings_with(**sizes: int) -> str:
    settings = json.loads((GOLDEN / "hpam.json").read_text())
    return json.dumps(settings | {"net_hyperparams": settings["net_hyperparams"] | sizes})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (None, r"hpam\.json"),
        ("[]", r"hpam\.json: hpam must be an object"),
        ('{"net_hyperparams": {}}', r"hpam\.json: hpam\.net_hyperparams\.W is missing"),
        (settings_with(shape_blocks=10_000_000), r"hpam\.json: shape_blocks of a field is 1 to 32, got 10000000"),
        (settings_with(W=32), r"models\.pth: not a checkpoint .*Error\(s\) in loading state_dict"),
    ],
)
def test_settings_of_another_network_or_of_none_are_named(settings: str | None, message: str, tmp_path: Path):
    if settings is not None:
        (tmp_path / "hpam.json").write_text(settings)
    with pytest.raises(ValueError, match=message):
        load_authors(GOLDEN / "models.pth", tmp_path / "hpam.json")


def test_a_checkpoint_of_parallel_training_in_capitals_is_read(golden: Model, tmp_path: Path):
    state = torch.load(GOLDEN / "models.pth", weights_only=True)
    state["model_params"] = {f"module.{name}": tensor for name, tensor in state["model_params"].items()}
    torch.save(state, tmp_path / "MODELS.PTH")
    settings = json.loads((GOLDEN / "hpam.json").read_text())
    settings["near"] = int(settings["near"])
    (tmp_path / "hpam.json").write_text("\ufeff" + json.dumps(settings), "utf-8")
    assert load_model(str(tmp_path / "MODELS.PTH")).fingerprint == golden.fingerprint


def test_a_bare_tensor_and_unequal_codes_are_named(tmp_path: Path):
    (tmp_path / "hpam.json").write_bytes((GOLDEN / "hpam.json").read_bytes())
    state = torch.load(GOLDEN / "models.pth", weights_only=True)
    path = tmp_path / "models.pth"
    torch.save(torch.ones(3), path)
    with pytest.raises(ValueError, match=r"models\.pth: it has no table model_params"):
        load_authors(path)
    state["shape_code_params"]["weight"] = state["shape_code_params"]["weight"][:1]
    torch.save(state, path)
    with pytest.raises(ValueError, match=r"models\.pth: it has 1 shape codes and \d+ texture codes"):
        load_authors(path)
