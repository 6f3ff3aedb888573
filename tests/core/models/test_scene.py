import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.edits.stretch import Stretch
from core.models.codes import Codes
from core.models.model import Instance, Model
from core.models.scene import Scene, embedded_scene, save_image
from tests.conftest import random_model

PIXELS = np.arange(6 * 5 * 3, dtype=np.uint8).reshape(6, 5, 3)


def random_scene(model: Model) -> Scene:
    instance = Instance(model, Codes(torch.randn(8) * 1e-3, torch.randn(4) * 1e3))
    return Scene(instance, model.camera(0.1 + 1e-15, 1 / 3))


def test_a_scene_comes_back_exactly_or_is_not_written(model: Model, tmp_path):
    scene = random_scene(model)
    scene.save(tmp_path / "s.json")
    again = Scene.load(tmp_path / "s.json", model)
    assert again == Scene.load(tmp_path / "s.json", model) == scene
    assert torch.equal(again.instance.codes.shape, scene.instance.codes.shape)
    sized = replace(scene, instance=scene.instance.with_edits(Stretch, Stretch((1.1, 0.9, 2 / 3))))
    sized.save(tmp_path / "s.json")
    assert Scene.load(tmp_path / "s.json", model) == sized != scene
    for path in (tmp_path / "gone" / "s.json", tmp_path):
        with pytest.raises(ValueError, match="cannot write"):
            random_scene(model).save(path)
    assert [path.name for path in tmp_path.iterdir()] == ["s.json"]


def test_a_scene_of_another_model_is_refused_by_name(model: Model, tmp_path):
    foreign = random_scene(random_model(seed=1))
    foreign.save(tmp_path / "s.json")
    save_image(PIXELS, tmp_path / "s.png", foreign)
    for name in ("s.json", "s.png"):
        with pytest.raises(ValueError, match=f"{name}: it belongs to another model"):
            Scene.load(tmp_path / name, model)


def test_a_scene_of_a_model_that_this_one_extends_becomes_one_of_this_model(model: Model, tmp_path):
    scene = random_scene(random_model(seed=1))
    scene.save(tmp_path / "s.json")
    extended = replace(model, extends=("0123456789abcdef", scene.instance.fingerprint))
    assert Scene.load(tmp_path / "s.json", extended) == replace(
        scene, instance=Instance(extended, scene.instance.codes)
    )


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"hello", b"\xff\xfe\x00", b'{"model": 1}', b'{"camera": {}, "model": "x"}']
)
def test_files_that_hold_no_scene_are_named(content: bytes, model: Model, tmp_path):
    path = tmp_path / "s.json"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"s\.json"):
        Scene.load(path, model)
    with pytest.raises(ValueError, match=r"gone\.json"):
        Scene.load(tmp_path / "gone.json", model)


@pytest.fixture
def scene(model: Model) -> Scene:
    return random_scene(model)


def test_a_png_brings_its_scene_back_exactly(scene: Scene, model: Model, tmp_path: Path):
    save_image(PIXELS, tmp_path / "a.PNG", scene)
    again = Scene.load(tmp_path / "a.PNG", model)
    assert again == scene
    assert torch.equal(again.instance.codes.texture, scene.instance.codes.texture)
    with Image.open(tmp_path / "a.PNG") as image:
        np.testing.assert_array_equal(np.asarray(image), PIXELS)
    assert [path.name for path in tmp_path.iterdir()] == ["a.PNG"]


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_other_formats_hold_pixels_only(scene: Scene, name: str, tmp_path: Path):
    save_image(PIXELS, tmp_path / name, scene)
    assert embedded_scene(tmp_path / name) is None


def test_no_scene_is_embedded_in_torn_and_plain_files(scene: Scene, model: Model, tmp_path: Path):
    save_image(PIXELS, tmp_path / "whole.png", scene)
    content = (tmp_path / "whole.png").read_bytes()
    for length in (0, 7, 8, 20, 40, 100):
        (tmp_path / "torn.png").write_bytes(content[:length])
        assert embedded_scene(tmp_path / "torn.png") is None, length
    (tmp_path / "text.png").write_text("hello")
    Image.fromarray(PIXELS).save(tmp_path / "plain.png")
    for name in ("text.png", "plain.png", "gone.png", "."):
        assert embedded_scene(tmp_path / name) is None
    with pytest.raises(ValueError, match=r"plain\.png"):
        Scene.load(tmp_path / "plain.png", model)


def test_the_scene_of_an_image_is_read_without_decoding_it(scene: Scene, tmp_path: Path):
    """The header claims 60,000 by 60,000 pixels, more than the file holds and memory would."""
    save_image(PIXELS, tmp_path / "a.png", scene)
    content = (tmp_path / "a.png").read_bytes()
    header = b"IHDR" + struct.pack(">II", 60_000, 60_000) + content[24:29]
    (tmp_path / "huge.png").write_bytes(content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:])
    assert embedded_scene(tmp_path / "huge.png") == scene.to_json()


@pytest.mark.parametrize(
    ("name", "reason"), [("a.xyz", r"must end in \.png"), ("a", r"must end in \.png"), ("gone/a.png", "cannot write")]
)
def test_an_image_that_cannot_be_written_leaves_nothing(scene: Scene, name: str, reason: str, tmp_path: Path):
    with pytest.raises(ValueError, match=reason):
        save_image(PIXELS, tmp_path / name, scene)
    assert list(tmp_path.iterdir()) == []
