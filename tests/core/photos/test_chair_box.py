import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.geometry.camera import Camera, camera_rotation
from core.models.library import load_model
from core.photos import chair_box
from core.photos.chair_box import chair_corners, chair_direction
from core.rendering.images import render_image


def projected(camera: Camera, half: tuple[float, float, float]) -> np.ndarray:
    """The centre and corners of a box, as the network names them, in shares of the image."""
    signs = [(0, 0, 0), *((x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))]
    # Right, up and front of the network are -x, z and y of the world.
    points = torch.tensor([(-x * half[0], z * half[1], y * half[2]) for x, y, z in signs], dtype=torch.float32)
    rotation = camera_rotation(torch.tensor(camera.azimuth), torch.tensor(camera.elevation))
    x, y, z = (points @ rotation.T).unbind(1)
    depth = camera.distance - z
    return torch.stack((x, -y), 1).div(depth[:, None]).mul(camera.focal / camera.width).add(0.5).numpy()


@pytest.mark.parametrize("azimuth", range(-180, 180, 45))
@pytest.mark.parametrize("focal", [0.8, 1.5, 2.5])
def test_the_azimuth_of_a_box_hardly_depends_on_the_focal_length(azimuth: float, focal: float):
    camera = Camera(math.radians(azimuth), math.radians(20), 2.0, 100 * focal, 100, 100)
    measured = math.degrees(chair_direction(projected(camera, (0.2, 0.25, 0.35)), 1.0)[0])
    assert abs((measured - azimuth + 180) % 360 - 180) < (0.1 if focal == 1.5 else 12)


def test_chairs_get_the_azimuth_they_are_rendered_from():
    model = load_model("chairs")
    correct = 0
    for index, azimuth in enumerate((70, 110, 40, 140)):
        camera = model.camera(math.radians(azimuth), math.radians(15)).resized(256, 256)
        colour = render_image(model[40 * index], camera).colour.clamp(0, 1)
        image = Image.fromarray((colour * 255).byte().numpy())
        corners = chair_corners(image, (0.2, 0.2, 0.8, 0.8))
        assert corners is not None
        measured = math.degrees(chair_direction(corners, 1.0)[0])
        correct += min(abs((measured - expected + 180) % 360 - 180) for expected in (azimuth, -azimuth)) < 30
    assert correct >= 3


@pytest.mark.parametrize("box", [(0.0, 0.0, 1.0, 1.0), (0.9, 0.9, 1.0, 1.0), (0.0, 0.4, 0.001, 0.401)])
def test_boxes_at_the_edges_of_any_image_have_finite_corners(box):
    for size in ((640, 40), (40, 640), (8, 8)):
        corners = chair_corners(Image.effect_noise(size, 60).convert("RGB"), box)
        assert corners is not None
        assert np.isfinite(corners).all()
        assert all(map(math.isfinite, chair_direction(corners, size[0] / size[1])))


def test_a_missing_network_gives_a_warning_and_no_corners(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog):
    monkeypatch.setattr(chair_box, "NETWORKS", tmp_path)
    assert chair_corners(Image.new("RGB", (32, 32)), (0.1, 0.1, 0.9, 0.9)) is None
    assert "objectron_chair.onnx is missing" in caplog.text
