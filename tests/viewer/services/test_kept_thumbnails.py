from pathlib import Path

import numpy as np

from core.models.model import Model
from viewer.services.kept_thumbnails import KeptThumbnails


def test_what_is_kept_is_there_again_and_what_is_broken_is_not(model: Model, tmp_path: Path) -> None:
    pictures = {name: np.random.default_rng(0).integers(0, 255, (4, 5, 4), dtype=np.uint8) for name in "ab"}
    kept = KeptThumbnails(tmp_path / "new")
    assert kept.load(model) == {}
    kept.save(model, pictures)
    found = KeptThumbnails(tmp_path / "new").load(model)
    assert found.keys() == pictures.keys()
    np.testing.assert_array_equal(found["b"], pictures["b"])
    (file,) = (tmp_path / "new").iterdir()
    file.write_bytes(b"no tensors")
    assert kept.load(model) == {}
    (tmp_path / "file").touch()
    KeptThumbnails(tmp_path / "file").save(model, pictures)  # that cannot be
    KeptThumbnails().save(model, pictures)
    assert KeptThumbnails().load(model) == {}
