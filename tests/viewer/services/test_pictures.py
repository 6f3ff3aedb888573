from pathlib import Path

import numpy as np

from viewer.services.pictures import read_pictures, write_pictures


def test_stored_pictures_are_read_and_damaged_files_are_empty(tmp_path: Path) -> None:
    pictures = {name: np.random.default_rng(0).integers(0, 255, (4, 5, 4), dtype=np.uint8) for name in "ab"}
    file = tmp_path / "new" / "pictures"
    assert read_pictures(file) == {}
    write_pictures(file, pictures)
    restored = read_pictures(file)
    assert restored.keys() == pictures.keys()
    np.testing.assert_array_equal(restored["b"], pictures["b"])
    file.write_bytes(b"no tensors")
    assert read_pictures(file) == {}
    write_pictures(file / "in a file", pictures)  # that cannot be
