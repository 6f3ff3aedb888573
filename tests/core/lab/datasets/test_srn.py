"""SRN folders: objects are read as written, genuine files are read, broken ones are named."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.geometry.camera import Camera
from core.lab.datasets.srn import ObjectViews, index_objects, read_dataset, write_manifest, write_object

SIZE = 16


def views(name: str, seed: int = 0, count: int = 4, size: int = SIZE) -> ObjectViews:
    """Return an object of noise, with cameras all around and one at the pole."""
    generator = np.random.default_rng(seed)
    masks = generator.random((count, size, size)) < 0.5
    images = np.where(masks[..., None], generator.integers(0, 255, (count, size, size, 3)), 255).astype(np.uint8)
    elevations = [*generator.uniform(-1.5, 1.5, count - 1), math.pi / 2]
    cameras = tuple(Camera(generator.uniform(-3, 3), e, 1.3, 16.4, size, size) for e in elevations)
    return ObjectViews(name, name, name, images, masks, cameras)


def test_objects_are_read_as_written(tmp_path: Path) -> None:
    written = [views("b", 1), views("a", 2)]
    for original in written:
        write_object(tmp_path, original)
    dataset = read_dataset(tmp_path)
    assert [loaded.name for loaded in dataset.objects] == ["a", "b"]
    assert (dataset.category, dataset.image_size, dataset.focal) == ("", SIZE, pytest.approx(16.4))
    for loaded, original in zip(dataset.objects, reversed(written), strict=True):
        assert np.array_equal(loaded.images, original.images)
        assert np.array_equal(loaded.masks, original.masks)
        for camera, expected in zip(loaded.cameras, original.cameras, strict=True):
            assert torch.allclose(camera.pose(), expected.pose(), rtol=0, atol=1e-6)


def test_reduced_views_are_means_of_areas() -> None:
    full_size = views("a")
    half = full_size.reduced(SIZE // 2)
    expected = full_size.images.reshape(4, SIZE // 2, 2, SIZE // 2, 2, 3).mean((2, 4))
    assert np.abs(half.images - expected).max() <= 1
    assert np.array_equal(half.masks, full_size.masks.reshape(4, SIZE // 2, 2, SIZE // 2, 2).mean((2, 4)) > 0.5)
    assert half.cameras[0] == full_size.cameras[0].resized(SIZE // 2, SIZE // 2)
    assert full_size.reduced(SIZE) is full_size


def test_objects_are_indexed_without_being_read_and_share_what_the_manifest_says(tmp_path: Path) -> None:
    write_manifest(tmp_path / "one", "chairs", {"a": ("shape-1", "oak"), "not yet": ("shape-1", "red")})
    write_object(tmp_path / "one", replace(views("a"), shape_id="s", texture_id="t"))
    write_object(tmp_path / "two", views("b"))
    (tmp_path / "two/b/rgb/000000.png").write_text("broken")
    category, (a, b) = index_objects([tmp_path / "one", tmp_path / "two"])
    assert category == "chairs"
    assert (a.name, a.shape_id, a.texture_id) == ("a", "shape-1", "oak")
    assert (b.name, b.shape_id, b.texture_id) == ("b", "b", "b")
    (loaded,) = read_dataset(tmp_path / "one").objects
    assert np.array_equal(a.read().images, loaded.images)
    assert (loaded.shape_id, loaded.texture_id) == ("shape-1", "oak")
    with pytest.raises(ValueError, match=r"000000\.png"):
        b.read()
    with pytest.raises(ValueError, match="two dataset folders"):
        index_objects([tmp_path / "one", tmp_path / "one"])
    write_manifest(tmp_path / "two", "cars", {})
    with pytest.raises(ValueError, match="cars, chairs"):
        index_objects([tmp_path / "one", tmp_path / "two"])


def test_writing_replaces_and_a_missing_mask_holds_pixels_off_white(tmp_path: Path) -> None:
    write_object(tmp_path, views("a", 0, count=4))
    write_object(tmp_path, views("a", 1, count=2))
    assert len(read_dataset(tmp_path).objects[0].cameras) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    original = views("a")
    write_object(tmp_path, original)
    shutil.rmtree(tmp_path / "a/mask")
    assert np.array_equal(read_dataset(tmp_path).objects[0].masks, (original.images < 253).any(-1))


def test_transparent_images_are_composited_on_white(tmp_path: Path) -> None:
    write_object(tmp_path, views("a", count=1))
    shutil.rmtree(tmp_path / "a/mask")
    pixels = np.zeros((SIZE, SIZE, 4), np.uint8)
    pixels[:, :8] = 200, 0, 0, 255
    pixels[:, 8] = 0, 0, 0, 128
    Image.fromarray(pixels).save(tmp_path / "a/rgb/000000.png")
    composite = read_dataset(tmp_path).objects[0]
    assert composite.images[0, 0, 0].tolist() == [200, 0, 0]
    assert composite.images[0, 0, 8].tolist() == [127, 127, 127]
    assert composite.images[0, 0, 9].tolist() == [255, 255, 255]
    assert composite.masks[0, 0].tolist() == [True] * 9 + [False] * 7


def test_a_resized_copy_keeps_its_field_of_view(tmp_path: Path) -> None:
    """SRN's intrinsics belong to the size that they name, which need not be the images'."""
    write_object(tmp_path, views("a"))
    (tmp_path / "a/intrinsics.txt").write_text("131.25 64. 64. 0.\n0. 0. 0.\n1.\n128 128\n")
    assert read_dataset(tmp_path).focal == pytest.approx(131.25 * SIZE / 128)


def test_genuine_srn_folders_are_read(shared: Path) -> None:
    dataset = read_dataset(shared / "upstream/srn_real")
    distances = {loaded.name: round(loaded.cameras[0].distance, 2) for loaded in dataset.objects}
    assert (dataset.image_size, dataset.focal) == (128, 131.25)
    assert distances == {"cars_idx0000": 1.3, "cars_idx0010": 1.3, "chairs_idx0004": 2.0}
    for loaded in dataset.objects:
        assert 0.03 < loaded.masks.mean() < 0.6
        assert not loaded.masks[0, 0].any()


@pytest.mark.parametrize(
    ("file", "content"),
    [
        *((missing, None) for missing in ("a/rgb", "a/pose", "a/pose/000001.txt", "a/intrinsics.txt")),
        ("a/pose/000002.txt", "1 2 3"),
        ("a/pose/000002.txt", "one two three"),
        ("a/pose/000002.txt", " ".join(["nan"] * 16)),
        ("a/pose/000002.txt", "1 0 0 0 0 1 0 0 0 0 1 2 0 0 0 1"),  # looks away from the origin
        ("a/intrinsics.txt", ""),
        ("a/intrinsics.txt", "-3 0 0 0\n16 16\n"),
        ("a/rgb/000003.png", "not an image"),
        ("a/mask/000003.png", "not an image"),
        ("manifest.json", '{"objects": {"a": {}}}'),
    ],
)
def test_missing_and_broken_files_are_named(tmp_path: Path, file: str, content: str | None) -> None:
    write_object(tmp_path, views("a"))
    path = tmp_path / file
    if content is not None:
        path.write_text(content)
    elif path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
    with pytest.raises(ValueError, match=path.parent.name if file == "a/pose/000001.txt" else path.name):
        read_dataset(tmp_path)


def test_images_of_several_sizes_and_missing_folders_are_refused(tmp_path: Path) -> None:
    write_object(tmp_path / "one", views("a"))
    write_object(tmp_path / "two", views("b", size=8))
    (tmp_path / "empty").mkdir()
    for folders, message in (
        (("one", "two"), "b: images of 8x8"),
        (("nowhere",), "nowhere"),
        (("empty",), "no object folders"),
        ((), "no dataset folder was given"),
    ):
        with pytest.raises(ValueError, match=message):
            read_dataset([tmp_path / folder for folder in folders])


def test_inconsistent_object_views_are_refused() -> None:
    good = views("a")
    with pytest.raises(ValueError, match="cameras for"):
        replace(good, cameras=good.cameras[:2])
    with pytest.raises((ValueError, TypeError), match="masks"):  # jaxtyping may see it first
        replace(good, masks=good.masks[:, :3])
    with pytest.raises(ValueError, match="size"):
        replace(good, cameras=tuple(camera.resized(8, 8) for camera in good.cameras))


def test_system_files_and_byte_order_marks_are_ignored(tmp_path: Path) -> None:
    write_object(tmp_path, views("a"))
    write_manifest(tmp_path, "chairs", {"a": ("s", "t")})
    expected = read_dataset(tmp_path)
    junk_files = "a/rgb/._000000.png a/pose/._000000.txt a/rgb/Thumbs.db __MACOSX/a/rgb/000000.png .DS_Store"
    for junk in junk_files.split():
        (tmp_path / junk).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / junk).write_bytes(b"\0\5\x16\7")
    for text in ("manifest.json", "a/intrinsics.txt", "a/pose/000000.txt"):
        (tmp_path / text).write_bytes(b"\xef\xbb\xbf" + (tmp_path / text).read_bytes())
    dataset = read_dataset(tmp_path)
    assert [loaded.name for loaded in dataset.objects] == ["a"]
    assert dataset.objects[0].cameras == expected.objects[0].cameras
    assert dataset.category == "chairs"


@pytest.mark.parametrize("suffix", [".PNG", ".jpg", ".JPEG", ".webp"])
def test_images_with_any_usual_suffix_are_read(suffix: str, tmp_path: Path) -> None:
    original = views("a")
    write_object(tmp_path, original)
    for path in (tmp_path / "a/rgb").iterdir():
        with Image.open(path) as image:
            image.save(path.with_suffix(suffix), quality=100, lossless=True)
        path.unlink()
    (loaded,) = read_dataset(tmp_path).objects
    assert np.array_equal(loaded.masks, original.masks)  # still named .png
    assert len(loaded.images) == 4
    if suffix in (".PNG", ".webp"):
        assert np.array_equal(loaded.images, original.images)


def write_nerf(folder: Path, views: ObjectViews, scale: float) -> None:
    """Write an object in front of a transparent ground, with cameras in other units, as NeRF-synthetic has it."""
    (folder / views.name / "train").mkdir(parents=True)
    frames = []
    for index, (image, mask, camera) in enumerate(zip(views.images, views.masks, views.cameras, strict=True)):
        pixels = np.dstack((image, np.full_like(mask, 255, np.uint8))) * mask[..., None]
        Image.fromarray(pixels).save(folder / views.name / f"train/r_{index}.png")
        matrix = camera.pose().numpy() @ np.diag([1.0, -1.0, -1.0, 1.0])
        matrix[:3, 3] /= scale
        frames.append({"file_path": f"./train/r_{index}", "rotation": 0.01, "transform_matrix": matrix.tolist()})
    angle = 2 * math.atan(camera.width / 2 / camera.focal)
    transforms = {"camera_angle_x": angle, "frames": frames}
    (folder / views.name / "transforms_train.json").write_text(json.dumps(transforms))


def square(name: str) -> ObjectViews:
    """Return an object that is a small square in all views."""
    noise = views(name, count=3)
    masks = np.zeros_like(noise.masks)
    masks[:, 6:10, 6:10] = True
    return replace(
        noise, masks=masks, cameras=tuple(Camera(0.5 * turn, 0.4, 1.3, 16.4, SIZE, SIZE) for turn in range(3))
    )


def test_folders_of_nerf_synthetic_are_a_category(tmp_path: Path) -> None:
    for name in ("lego", "drums"):
        write_nerf(tmp_path, square(name), 0.25)
    write_manifest(tmp_path, "toys", {})
    dataset = read_dataset(tmp_path, scale=0.25)
    assert ([views.name for views in dataset.objects], dataset.category) == (["drums", "lego"], "toys")
    assert dataset.focal == pytest.approx(16.4)
    for camera, expected in zip(dataset.objects[1].cameras, square("lego").cameras, strict=True):
        assert torch.allclose(camera.pose(), expected.pose(), rtol=0, atol=1e-6)
    assert dataset.objects[0].masks.sum() == 3 * 16
    assert dataset.objects[0].images[0, 0, 0].tolist() == [255, 255, 255]
    both = read_dataset([tmp_path / "lego", tmp_path / "drums/transforms_train.json"], (1, 3), 0.25)
    assert [views.name for views in both.objects] == ["lego", "drums"]
    assert both.weights == (1, 3)


def test_a_nerf_folder_in_other_units_names_the_scale(tmp_path: Path) -> None:
    write_nerf(tmp_path, square("lego"), 0.1)
    with pytest.raises(ValueError, match=r"transforms_train\.json: .* 3\.\d+ scene units across .*--pose-scale 0\.3"):
        read_dataset(tmp_path)
    (tmp_path / "lego/train/r_1.png").unlink()
    with pytest.raises(ValueError, match=r"transforms_train\.json: there is no image .*r_1"):
        read_dataset(tmp_path, scale=0.1)
