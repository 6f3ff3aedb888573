"""Readers of files from elsewhere against damage: a value, or one ``ValueError`` of one line that names the file.

A few whole files, each with 200 seeded corruptions.
"""

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from PIL import Image

from core.geometry.camera import Camera
from core.geometry.pose_files import read_pose
from core.lab.datasets.srn import index_objects, write_manifest
from core.lab.training.held_out import read_curve
from core.models.authors_checkpoint import load_authors
from core.models.model import Model
from core.models.scene import Scene, save_image, scene_model
from core.photos.decode import lens_focal, read_rgba, upright_size
from tests.conftest import random_model
from tests.core.models.authors_reference import GOLDEN

_CORRUPTIONS = 200
_MODEL = random_model()
_SCENE = Scene(_MODEL[0], _MODEL.camera(0.3, 0.2))
_INTERESTING = (
    b"\0",
    b"\xff",
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\xff",
    b"1e999",
    b"NaN",
    b"-1",
    b"[",
    b"{",
    b"\xef\xbb\xbf",
)


def _image(kind: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        exif = Image.Exif()
        exif[0x0112] = 6
        options = {"exif": exif} if kind in ("JPEG", "PNG", "WEBP", "TIFF") else {}
        Image.effect_noise((48, 40), 60).convert("RGB").save(path, kind, **options)

    return write


def _read_image(path: Path) -> None:
    upright_size(path)
    lens_focal(read_rgba(path))


def _write_scene_image(path: Path) -> None:
    pixels = torch.zeros(8, 8, 3, dtype=torch.uint8).numpy()
    save_image(pixels, path.with_suffix(".png"), _SCENE)
    path.write_bytes(path.with_suffix(".png").read_bytes())


def _write_pose(path: Path) -> None:
    path.write_text(" ".join(map(str, Camera(0.3, 0.4, 1.3, 131.25, 128, 96).pose().flatten().tolist())))


def _write_manifest(path: Path) -> None:
    (path.parent / "an object").mkdir()
    write_manifest(path.parent, "chairs", {"a": ("s", "t"), "b": ("s", "u")})
    path.write_bytes((path.parent / "manifest.json").read_bytes())


def _read_manifest(path: Path) -> None:
    path.replace(path.with_name("manifest.json"))
    index_objects([path.parent])


def _read_settings(path: Path) -> None:
    load_authors(GOLDEN / "models.pth", path)


def _read_scene(path: Path) -> None:
    scene_model(path)
    Scene.load(path, _MODEL)


READERS: dict[str, tuple[Callable[[Path], object], Callable[[Path], object]]] = {
    **{f"{kind} image": (_image(kind), _read_image) for kind in ("PNG", "JPEG", "WEBP", "AVIF", "TIFF", "BMP", "GIF")},
    "scene": (_SCENE.save, _read_scene),
    "scene in an image": (_write_scene_image, _read_scene),
    "pose": (_write_pose, read_pose),
    "model": (_MODEL.save, Model.load),
    "authors' checkpoint": (
        lambda path: path.write_bytes((GOLDEN / "models.pth").read_bytes()),
        lambda path: load_authors(path, GOLDEN / "hpam.json"),
    ),
    "authors' settings": (lambda path: path.write_bytes((GOLDEN / "hpam.json").read_bytes()), _read_settings),
    "manifest": (_write_manifest, _read_manifest),
    "curve": (lambda path: path.write_text(json.dumps({"a": [{"step": 1, "seconds": 2.0, "psnr": 3.0}]})), read_curve),
}


def corrupted(original: bytes, generator: random.Random) -> bytes:
    """Bytes changed, mostly in the head; a piece replaced, omitted or repeated; or the end cut off."""
    content = bytearray(original)
    for _ in range(generator.choice((1, 1, 3, 20))):
        place = generator.randrange(min(len(content), generator.choice((64, 512, len(content)))))
        content[place] = generator.randrange(256)
    place = generator.randrange(len(content))
    length = generator.randrange(1, 64)
    match generator.randrange(6):
        case 0:
            del content[place:]
        case 1:
            del content[place : place + length]
        case 2:
            content[place:place] = content[place : place + length] * 3
        case 3:
            piece = generator.choice(_INTERESTING)
            content[place : place + len(piece)] = piece
        case 4:
            content += generator.randbytes(length)
    return bytes(content)


@pytest.mark.filterwarnings("ignore")  # of Pillow about damaged images
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_raise_one_line_that_names_the_file(name: str, tmp_path: Path) -> None:
    write, read = READERS[name]
    path = tmp_path / "file.bin"
    generator = random.Random(name)
    write(path)
    original = path.read_bytes()
    read(path)  # undamaged
    for _ in range(_CORRUPTIONS):
        path.write_bytes(corrupted(original, generator))
        try:
            read(path)
        except ValueError as error:
            text = str(error)
            assert "\n" not in text
            assert str(tmp_path) in text
