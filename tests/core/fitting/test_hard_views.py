"""A guard of the confidence: views of unseen chairs, of which three are known to be hard."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.fitting.confidence import RIGHT_DEGREES
from core.fitting.fit import PRESETS, FitJob, fit
from core.metrics import rotation_error
from core.models.library import load_model
from core.photos.photo import Photo

FOLDER = Path(__file__).parents[2] / "files/hard_views"  # renders of CC0 meshes of Poly Haven and ShareTextures
SURE = 0.8


@pytest.mark.slow
@pytest.mark.parametrize(("name", "direction"), json.loads((FOLDER / "cameras.json").read_text()).items())
def test_no_wrong_camera_is_sure(name: str, direction: tuple[float, float]):
    model = load_model("chairs")
    rgba = torch.from_numpy(np.array(Image.open(FOLDER / name)))
    photo = Photo(rgba[..., :3] / 255.0, rgba[..., 3] > 127)
    *_, step = fit(model, FitJob((photo,), replace(PRESETS["normal"], free_steps=0)))
    assert step.confidence is not None
    assert step.confidence < SURE or rotation_error(step.cameras[0], model.camera(*direction)) < RIGHT_DEGREES
