from pathlib import Path

import numpy as np
from PIL import Image

from core.models.model import Model
from tests.viewer.driver import finish
from viewer.activities.mix_image import STEPS, mixes
from viewer.editor import Editor
from viewer.session import Session


def test_shapes_go_to_the_right_and_textures_upwards(model: Model) -> None:
    a, b = model.codes[1], model.codes[2]
    found = mixes(a, b)
    assert len(found) == STEPS**2
    assert found[0, 0] == a and found[STEPS - 1, STEPS - 1] == b
    np.testing.assert_allclose(found[STEPS - 1, 0].shape, b.shape, atol=1e-6)
    np.testing.assert_allclose(found[0, STEPS - 1].texture, b.texture, atol=1e-6)


def test_all_mixes_are_one_image(session: Session, editor: Editor, tmp_path: Path) -> None:
    editor.show_object("object 1")
    editor.set_b("object 2")
    session.exporting.mixes(tmp_path / "mixes.png", size=16)
    finish(session)
    with Image.open(tmp_path / "mixes.png") as image:
        assert image.size == (80, 80)
