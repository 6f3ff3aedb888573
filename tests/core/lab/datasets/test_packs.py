"""Packs: what is written comes back, several read like folders, and broken ones are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.lab.datasets.packs import index_pack
from core.lab.datasets.srn import ObjectViews, pack_datasets, read_dataset, write_manifest, write_object
from tests.core.lab.datasets.test_srn import views


def smooth(name: str, count: int = 5, size: int = 32) -> ObjectViews:
    """An object of one colour with a random mask."""
    noisy = views(name, len(name), count, size)
    images = np.full_like(noisy.images, 255)
    images[noisy.masks] = (200, 60, 30)
    return replace(noisy, images=images, shape_id=f"{name}-shape", texture_id="red")


def packed(folder: Path, objects: list[ObjectViews], size: int | None = None) -> Path:
    write_manifest(folder, "chairs", {views.name: (views.shape_id, views.texture_id) for views in objects})
    for object_views in objects:
        write_object(folder, object_views)
    path = folder.with_suffix(".views")
    assert list(pack_datasets([folder], path, size, 90)) == sorted(views.name for views in objects)
    return path


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_pack_reads_like_its_folder(tmp_path: Path, count: int) -> None:
    path = packed(tmp_path / "a", [smooth("b", count), smooth("aa", count)])
    folder = read_dataset(tmp_path / "a")
    pack = read_dataset(path)
    assert (pack.category, pack.image_size, pack.focal) == ("chairs", 32, folder.focal)
    for original, copied in zip(folder.objects, pack.objects, strict=True):
        assert (copied.name, copied.shape_id, copied.texture_id) == (original.name, f"{original.name}-shape", "red")
        assert np.array_equal(copied.masks, original.masks)
        assert np.abs(copied.images.astype(int) - original.images).mean() < 40  # of a mask of noise, the worst case
        for camera, expected in zip(copied.cameras, original.cameras, strict=True):
            assert camera.azimuth == pytest.approx(expected.azimuth, abs=1e-6)
            assert camera.elevation == pytest.approx(expected.elevation, abs=1e-6)
            assert camera.distance == pytest.approx(expected.distance)


def test_antialiased_colours_beside_a_mask_are_kept(tmp_path: Path) -> None:
    grey = smooth("grey")
    grey = replace(grey, images=np.full_like(grey.images, 128), masks=np.zeros_like(grey.masks))
    (copied,) = read_dataset(packed(tmp_path / "a", [grey])).objects
    assert np.abs(copied.images.astype(int) - 128).max() < 4


def test_several_packs_have_shares_and_a_scale(tmp_path: Path) -> None:
    first = packed(tmp_path / "a", [smooth("a"), smooth("bb")])
    second = packed(tmp_path / "b", [smooth("ccc")])
    dataset = read_dataset([first, second], [0.6, 0.4], scale=2.0)
    assert dataset.weights == (0.3, 0.3, 0.4)
    assert dataset.objects[0].cameras[0].distance == pytest.approx(2.6)
    with pytest.raises(ValueError, match="a: two dataset folders"):
        read_dataset([first, tmp_path / "a"])


def test_larger_images_are_reduced(tmp_path: Path) -> None:
    original = smooth("a")
    (copied,) = read_dataset(packed(tmp_path / "a", [original], 16)).objects
    assert np.array_equal(copied.masks, original.reduced(16).masks)
    assert copied.cameras[0].focal == pytest.approx(original.cameras[0].focal / 2)


def test_objects_of_another_size_leave_no_pack(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="16x16 among others of 32x32"):
        packed(tmp_path / "a", [smooth("a"), smooth("bb", size=16)])
    assert not list(tmp_path.glob("*.views"))


def test_a_broken_pack_is_named(tmp_path: Path) -> None:
    path = packed(tmp_path / "a", [smooth("a")])
    content = path.read_bytes()
    for broken in (b"", content[:-200], content.replace(b"codenerf-views-1", b"codenerf-views-9")):
        broken_path = tmp_path / f"{len(broken)}{broken[-1:].hex()}.views"
        broken_path.write_bytes(broken)
        with pytest.raises(ValueError, match=broken_path.name):
            index_pack(broken_path)
    damaged = tmp_path / "damaged.views"
    damaged.write_bytes(content.replace(b"WEBP", b"WEBX"))
    with pytest.raises(ValueError, match="damaged"):
        read_dataset(damaged)
