from dataclasses import replace
from pathlib import Path

import pytest
import torch

from core.fitting.fit import FitJob, FitSettings
from core.lab.datasets.srn import ObjectEntry, index_objects, write_manifest, write_object
from core.lab.evaluation import disentanglement as module
from core.lab.evaluation.disentanglement import pairs, probe, score_pairs, summarise_pairs
from core.lab.evaluation.report import format_disentanglement, write_disentanglement_report
from core.models.codes import CodeBook
from core.models.model import Instance, Model
from tests.core.lab.evaluation.test_protocol import views_of

IDS = {"stool0": (0, 1), "stool1": (1, 0), "stool2": (2, 3), "stool3": (3, 2), "new01": (0, 0), "new23": (2, 2)}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = FitSettings(steps=20, rays=64, samples=16)
    monkeypatch.setattr(module, "FitJob", lambda photos, seed: FitJob(photos, settings, seed))


@pytest.fixture(scope="module")
def factorial(tiny: Model, tmp_path_factory: pytest.TempPathFactory) -> tuple[ObjectEntry, ...]:
    """Return the training objects, and two of their shapes in textures not trained together with them."""
    folder = tmp_path_factory.mktemp("factorial")
    shapes = tiny.codes.shapes
    textures = tiny.codes.textures
    for name, (shape, texture) in IDS.items():
        book = CodeBook(shapes[[shape]], textures[[texture]], (tiny.codes.objects[0]._replace(shape=0, texture=0),))
        write_object(folder, replace(views_of(replace(tiny, codes=book), 0, 3), name=name))
    write_manifest(folder, "stools", {name: (f"s{shape}", f"t{texture}") for name, (shape, texture) in IDS.items()})
    return index_objects([folder])[1]


def test_pairs_take_codes_of_valid_objects_matched_by_name(tiny: Model, factorial):
    by_name = {pair.entry.name: pair for pair in pairs(tiny, factorial)}
    for name, (shape, texture) in IDS.items():
        assert (by_name[name].shape, by_name[name].texture) == (shape, texture)
        assert by_name[name].trained == name.startswith("stool")
    lost = replace(tiny, codes=replace(tiny.codes, collapsed=frozenset({0})))
    assert "new01" not in {pair.entry.name for pair in pairs(lost, factorial)}
    with pytest.raises(ValueError, match="no held-out pair: the model was trained on 4 of the 4"):
        pairs(tiny, [entry for entry in factorial if entry.name.startswith("stool")])


def test_recombined_codes_render_the_true_pair_and_textures_move_nothing(tiny: Model, factorial, tmp_path: Path):
    scores = list(score_pairs(tiny, pairs(tiny, factorial)))
    summary = summarise_pairs(scores)
    assert (summary.recombined_pairs, summary.trained_pairs) == (2, 4)
    assert summary.recombined.mean > 35
    assert summary.trained.mean > 35
    assert summary.refitted.mean > 25  # of short fits
    assert summary.opacity_change == 0
    assert summary.background_change < 1e-3  # all light of the object on background pixels
    text = format_disentanglement(scores)
    assert "at most 0 of full opacity" in text
    assert "texture from shape codes" in text
    unfitted = format_disentanglement([replace(score, refitted=None, fitted_codes=None) for score in scores])
    assert "other views" in text
    assert "other views" not in unfitted
    assert "nan" not in unfitted
    write_disentanglement_report(tmp_path / "s.json", scores, {"model": "m"})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.json", "s.png"]


def test_wrong_codes_score_badly(tiny: Model, factorial):
    wrong = [replace(pair, shape=3 - pair.shape) for pair in pairs(tiny, factorial) if not pair.trained]
    assert summarise_pairs(list(score_pairs(tiny, wrong))).recombined.mean < 24


def test_a_leaking_field_changes_opacity_and_background(tiny: Model, factorial, monkeypatch: pytest.MonkeyPatch):
    honest = module.render_image

    def leaking(instance: Instance, camera, samples: int | None = None):
        frame = honest(instance, camera, samples)
        return replace(
            frame,
            colour=frame.colour - 0.1 * instance.codes.texture[0],
            opacity=frame.opacity * (0.75 + instance.codes.texture[0] / 4),
        )

    monkeypatch.setattr(module, "render_image", leaking)
    score, _ = score_pairs(tiny, [pair for pair in pairs(tiny, factorial) if not pair.trained])
    assert score.opacity_change > 0.4
    assert score.background_change == pytest.approx(0.2, abs=0.01)


# Probes


def grid(shapes: int, textures: int) -> tuple[list[int], list[int]]:
    return zip(*[(s, t) for s in range(shapes) for t in range(textures)], strict=True)


def test_a_probe_recovers_encoded_labels_and_only_those():
    shape_ids, texture_ids = grid(20, 5)
    generator = torch.Generator().manual_seed(0)
    shape_codes = torch.randn(20, 6, generator=generator)[list(shape_ids)]
    noise = 0.1 * torch.randn(100, 6, generator=generator)
    own = probe(shape_codes + noise, shape_ids, texture_ids)
    leak = probe(shape_codes + noise, texture_ids, shape_ids)
    assert own.accuracy.mean > 0.95
    assert own.chance == pytest.approx(1 / 20)
    assert leak.chance == pytest.approx(1 / 5)
    assert leak.accuracy.low - 0.12 < leak.chance < leak.accuracy.high + 0.12
    stained = shape_codes + 2 * torch.randn(5, 6, generator=generator)[list(texture_ids)]
    caught = probe(stained, texture_ids, shape_ids)
    assert caught.accuracy.low > 0.5
    assert probe(torch.zeros(3, 2), [0, 1, 2], [0, 1, 2]) is None
