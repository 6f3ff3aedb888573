"""The table of shapes x textures, textures, and the images of both."""

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.lab.datasets.procedural.cars.car import car
from core.lab.datasets.procedural.cars.paint import LABELS as car_labels
from core.lab.datasets.procedural.cars.paint import car_texture
from core.lab.datasets.procedural.chairs.chair import LABELS as chair_labels
from core.lab.datasets.procedural.chairs.chair import chair
from core.lab.datasets.procedural.paint import Paint, texture
from core.lab.datasets.procedural.solids import Shape
from core.lab.datasets.procedural.table import (
    ProceduralObject,
    disentanglement_pairs,
    procedural_table,
    procedural_tasks,
    surfaces,
)
from core.lab.datasets.rasteriser import Rasteriser
from core.lab.datasets.render_objects import render_objects
from core.lab.datasets.srn import read_dataset
from core.lab.datasets.srn_cameras import training_views
from tests.core.lab.datasets.procedural.shapes import points


@given(count=st.integers(6, 3000))
def test_the_table_is_sparse_and_connected(count: int) -> None:
    objects = procedural_table("chairs", count, "train")
    assert len({(item.shape, item.texture) for item in objects}) == count
    shapes, textures = Counter(item.shape for item in objects), Counter(item.texture for item in objects)
    assert len(shapes) == (count + 1) // 2
    assert len(textures) == count // 3
    assert set(shapes.values()) <= {1, 2, 3}
    assert min(textures.values()) >= 2
    assert all(len({item.shape for item in objects if item.texture == t}) >= 2 for t in list(textures)[:5])


@pytest.mark.parametrize("count", range(1, 7))
def test_small_tables_have_no_pair_twice(count: int) -> None:
    objects = procedural_table("chairs", count, "train")
    assert len({item.name for item in objects}) == count


def test_training_and_test_share_no_seed() -> None:
    train, test = (procedural_table("chairs", 500, split) for split in ("train", "test"))
    assert not {item.shape for item in train} & {item.shape for item in test}
    assert not {item.texture for item in train} & {item.texture for item in test}
    assert min(item.shape for item in test) == 1_000_000


def test_unknown_categories_and_counts_are_refused() -> None:
    with pytest.raises(ValueError, match="boats"):
        procedural_table("boats", 3, "train")
    with pytest.raises(ValueError, match="0"):
        procedural_table("chairs", 0, "train")


@pytest.mark.parametrize("make", [chair, car])
def test_the_same_seed_is_the_same_shape_and_another_is_another(make: Callable[[int], Shape]) -> None:
    first, again, other = (points(make(seed)) for seed in (11, 11, 12))
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


@pytest.mark.parametrize(("paint", "labels"), [(texture, chair_labels), (car_texture, car_labels)])
def test_every_texture_paints_every_label_the_same_way_each_time(
    paint: Callable[[int], Mapping[str, Paint]], labels: tuple[str, ...]
) -> None:
    for seed in range(60):
        first, again = paint(seed), paint(seed)
        assert set(first) == set(labels)
        for label, of_label in first.items():
            tile = of_label.tile
            assert np.array_equal(tile, again[label].tile)
            assert tile.dtype == np.uint8
            assert (tile[..., 3] == 255).all()
            # Black and white leave nothing for the light to shade.
            assert tile[..., :3].min() >= 15
            assert tile[..., :3].max() <= 243


def test_patterns_repeat_without_a_seam() -> None:
    """A tile's step over its border is no larger than its largest step inside."""
    for seed in range(60):
        for paint in texture(seed).values():
            tile = paint.tile[..., :3].astype(int)
            for axis in (0, 1):
                inside = np.abs(np.diff(tile, axis=axis)).mean((axis, 2)).max()
                inside = max(inside, np.abs(np.diff(tile, axis=axis)).mean((1 - axis, 2)).max())
                seam = np.abs(tile.take(0, axis) - tile.take(-1, axis)).mean()
                assert seam <= 1.5 * inside + 3


def test_a_texture_colours_many_shapes_alike(rasteriser: Rasteriser) -> None:
    """The same texture on two chairs of a kind: their mean colours are closer than those of other textures."""
    four_legs = [seed for seed in range(40) if chair(seed).kind == "four-leg"][:2]
    camera = training_views(1, np.random.default_rng(2), 2.0, 64)[0]

    def mean_colour(shape: int, look: int) -> np.ndarray:
        rasteriser.upload(surfaces(ProceduralObject("chairs", shape, look)))
        image, mask = rasteriser.render(camera)
        return image[mask].mean(0)

    first, second = ([mean_colour(shape, look) for look in range(12)] for shape in four_legs)
    distance = np.linalg.norm(np.array(first)[:, None] - np.array(second)[None], axis=-1)
    assert np.median(np.diag(distance)) < 0.5 * np.median(distance)


@pytest.mark.parametrize(
    ("category", "distance", "seeds", "views", "least"),
    [("chairs", 2.0, range(0, 60, 3), 2, 0.01), ("cars", 1.3, range(0, 30, 3), 3, 0.05)],
)
def test_no_object_is_cut_off_by_the_image(
    rasteriser: Rasteriser, category: str, distance: float, seeds: range, views: int, least: float
) -> None:
    generator = np.random.default_rng(0)
    for seed in seeds:
        rasteriser.upload(surfaces(ProceduralObject(category, seed, seed)))
        for camera in training_views(views, generator, distance, 64):
            _, mask = rasteriser.render(camera)
            assert not np.concatenate((mask[0], mask[-1], mask[:, 0], mask[:, -1])).any()
            assert mask.mean() > least


def test_rendering_writes_a_dataset_with_identities(tmp_path: Path, rasteriser: Rasteriser) -> None:
    objects = procedural_table("chairs", 6, "train")
    names = list(render_objects(procedural_tasks(objects), tmp_path, "chairs", "train", 2, 32))
    dataset = read_dataset(tmp_path)
    assert names == [item.name for item in objects]
    assert sorted(names) == [one.name for one in dataset.objects]
    assert len({one.shape_id for one in dataset.objects}) == 3
    assert len({one.texture_id for one in dataset.objects}) == 2
    assert dataset.category == "chairs"


def test_half_of_the_disentanglement_pairs_are_trained_and_every_shape_and_texture_is_known():
    trained, objects = set(procedural_table("chairs", 600, "train")), disentanglement_pairs("chairs", 600, 4)
    known = [item for item in objects if item in trained]
    assert len(set(objects)) == 64
    assert len(known) == 32
    assert {item.shape for item in known} == {item.shape for item in objects}
    assert {item.texture for item in known} == {item.texture for item in objects}
    with pytest.raises(ValueError, match="3 tables"):
        disentanglement_pairs("chairs", 30, 3)
