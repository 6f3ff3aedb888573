from dataclasses import replace

import pytest
import torch

from core.lab.datasets.srn import Dataset, ObjectViews
from core.lab.training.held_out import held_out_psnr, hold_out
from core.lab.training.recipes import RECIPES, TrainSettings
from core.lab.training.trainer import Trainer, TrainStep
from core.models.field_config import FieldConfig
from tests.conftest import unchecked_shapes
from tests.core.lab.training.test_visual_hull import ball

SETTINGS = TrainSettings(
    FieldConfig(width=16, shape_latent=4, texture_latent=4, position_frequencies=3, direction_frequencies=1),
    steps=60,
    rays=128,
    samples=24,
    outside_points=64,
    muon_lr=5e-2,
    network_lr=1e-2,
    code_lr=1e-2,
)
NARROW = replace(SETTINGS, field=replace(SETTINGS.field, width=8))


def coloured(name: str, colour: tuple[int, int, int], centre: tuple[float, float, float]) -> ObjectViews:
    views = ball(0.3, centre, count=8, size=32)
    images = views.images.copy()
    images[views.masks] = colour
    return replace(views, name=name, shape_id=name, texture_id=name, images=images)


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    objects = (coloured("red", (200, 30, 20), (0.1, 0, 0)), coloured("blue", (10, 40, 220), (-0.1, 0.05, 0)))
    return Dataset(objects, "balls", 32, objects[0].cameras[0].focal)


def weights_of(trainer: Trainer) -> torch.Tensor:
    return torch.cat([value.flatten() for value in trainer.ema_parameters])


def all_steps(trainer: Trainer) -> list[TrainStep]:
    """Train to the end; shapes are checked in the first step."""
    stream = trainer.steps()
    first = next(stream)
    with unchecked_shapes():
        return [first, *stream]


def test_training_raises_the_quality_of_held_out_views(dataset: Dataset):
    training, held_out = hold_out(dataset)
    assert len(training.objects[0].cameras) == 7
    assert len(held_out.objects[0].cameras) == 1
    trainer = Trainer(training, replace(SETTINGS, steps=300))
    initial_psnr = held_out_psnr(trainer.model(), held_out, 24)
    steps = all_steps(trainer)
    assert [step.step for step in steps] == list(range(1, 301))
    assert sum(step.psnr for step in steps[-50:]) > sum(step.psnr for step in steps[:50]) + 50 * 2
    assert held_out_psnr(trainer.model(), held_out, 24) > initial_psnr + 1.5


def test_textures_share_codes_and_the_papers_recipe_uses_no_hull(dataset: Dataset):
    shared = tuple(replace(views, texture_id="same") for views in dataset.objects)
    model = Trainer(replace(dataset, objects=shared), SETTINGS).model()
    assert (len(model.codes.shapes), len(model.codes.textures), len(model.codes)) == (2, 1, 2)
    assert (model.category, model.image_size, model.distance) == ("balls", 32, 2.0)
    trainer = Trainer(dataset, replace(SETTINGS, whole_image=True))
    assert trainer.ray_dataset.hulls.all()
    *_, mask_class = trainer.ray_dataset.sample(2000, torch.Generator().manual_seed(0))
    covered = torch.cat([torch.from_numpy(views.masks).flatten() for views in dataset.objects]).float().mean()
    assert abs(float((mask_class == 2).float().mean()) - float(covered)) < 0.1


@pytest.mark.parametrize("recipe", ["paper", "M1", "M2"])
def test_every_recipe_learns(dataset: Dataset, recipe: str):
    names = ("width", "shape_latent", "texture_latent", "position_frequencies", "direction_frequencies")
    field = replace(RECIPES[recipe].field, **{name: getattr(SETTINGS.field, name) for name in names})
    settings = replace(RECIPES[recipe], field=field, steps=200, rays=128, samples=24, network_lr=1e-2, code_lr=1e-2)
    steps = all_steps(Trainer(dataset, settings))
    assert sum(step.psnr for step in steps[-50:]) > sum(step.psnr for step in steps[:50]) + 50 * 0.2


def test_a_resumed_run_ends_like_an_uninterrupted_one(dataset: Dataset, tmp_path):
    uninterrupted = Trainer(dataset, SETTINGS)
    all_steps(uninterrupted)
    first = Trainer(dataset, SETTINGS)
    for step in first.steps():
        if step.step == 25:
            break
    first.save_state(tmp_path / "run.state")
    second = Trainer(dataset, SETTINGS)
    second.load_state(tmp_path / "run.state")
    assert all_steps(second)[0].step == 26
    torch.testing.assert_close(weights_of(second), weights_of(uninterrupted), atol=1e-5, rtol=1e-4)


def test_muon_optimises_matrices_except_in_the_papers_recipe(dataset: Dataset):
    trainer = Trainer(dataset, SETTINGS)
    adam, muon = trainer.optimisers
    assert isinstance(muon, torch.optim.Muon)
    groups = (*adam.param_groups, *muon.param_groups)
    identities = [id(parameter) for group in groups for parameter in group["params"]]
    assert len(identities) == len(set(identities)) == len(trainer.ema_parameters)
    assert any(matrix is trainer.field.feature_layer.weight for matrix in muon.param_groups[0]["params"])
    (optimiser,) = Trainer(dataset, replace(SETTINGS, muon_lr=None)).optimisers
    assert isinstance(optimiser, torch.optim.AdamW)
    assert RECIPES["paper"].muon_lr is None


def test_a_resumed_run_takes_the_learning_rates_of_its_settings(dataset: Dataset, tmp_path):
    first = Trainer(dataset, SETTINGS)
    next(first.steps())
    first.save_state(tmp_path / "run.state")
    slower = replace(SETTINGS, muon_lr=1e-9, network_lr=1e-9, code_lr=1e-9)
    second = Trainer(dataset, slower)
    second.load_state(tmp_path / "run.state")
    initial_weight = second.field.feature_layer.weight.detach().clone()
    next(second.steps())
    torch.testing.assert_close(second.field.feature_layer.weight, initial_weight, atol=1e-7, rtol=0)


def test_training_continues_from_a_model_with_the_codes_of_its_objects(dataset: Dataset):
    first = Trainer(dataset, SETTINGS)
    all_steps(first)
    model = first.model()
    green = coloured("green", (20, 200, 30), (0.0, 0.1, 0))
    extended = replace(dataset, objects=(green, *dataset.objects))
    second = Trainer(extended, SETTINGS.continued(True))
    second.initialise_from(model)
    initial = second.model()
    for index in (0, 1):
        torch.testing.assert_close(initial.codes[index + 1].shape, model.codes[index].shape)
        torch.testing.assert_close(initial.codes[index + 1].texture, model.codes[index].texture)
    assert model.extends == ()
    assert initial.extends == (model.fingerprint,)
    torch.testing.assert_close(initial.codes[0].shape, model.codes.mean.shape.half().float())
    pairs = zip(initial.field.parameters(), model.field.parameters(), strict=True)
    assert all(torch.equal(*pair) for pair in pairs)
    assert len(all_steps(second)) == SETTINGS.steps
    with pytest.raises(ValueError, match="cannot start"):
        Trainer(extended, NARROW).initialise_from(model)


def test_a_trained_network_learns_slowly_and_new_objects_at_their_full_rate():
    for gentle, network, instance in ((SETTINGS.continued(False), 0.05, 0.05), (SETTINGS.continued(True), 0.5, 1.0)):
        assert gentle.network_lr == pytest.approx(network * SETTINGS.network_lr)
        assert gentle.code_lr == pytest.approx(instance * SETTINGS.code_lr)
    assert RECIPES["paper"].continued(True).muon_lr is None


def test_a_state_of_another_run_is_refused(dataset: Dataset, tmp_path):
    Trainer(dataset, SETTINGS).save_state(tmp_path / "run.state")
    for path in (tmp_path / "run.state", tmp_path / "gone.state"):
        with pytest.raises(ValueError, match=path.name):
            Trainer(dataset, NARROW).load_state(path)
    with pytest.raises(ValueError, match=r"run\.state"):
        Trainer(dataset, replace(SETTINGS, muon_lr=None)).load_state(tmp_path / "run.state")
    reordered = replace(dataset, objects=dataset.objects[::-1])
    with pytest.raises(ValueError, match="other objects"):
        Trainer(reordered, SETTINGS).load_state(tmp_path / "run.state")


def test_pruning_removes_empty_cells_alone(dataset: Dataset):
    trainer = Trainer(dataset, SETTINGS)
    hulls = trainer.ray_dataset.hulls.clone()
    layer = trainer.field.density_layer
    layer.weight.data.zero_()
    layer.bias.data.fill_(0.0)
    bias = trainer.field.shape_bias(trainer.shapes)[trainer.shape_row]
    trainer.ray_dataset.prune(trainer.field, bias)
    assert torch.equal(trainer.ray_dataset.hulls, hulls)
    layer.bias.data.fill_(-20.0)
    trainer.ray_dataset.prune(trainer.field, bias)
    assert not trainer.ray_dataset.hulls.any()


def test_single_views_and_diverging_runs_raise_an_error(dataset: Dataset):
    views = dataset.objects[0]
    single = replace(views, images=views.images[:1], masks=views.masks[:1], cameras=views.cameras[:1])
    with pytest.raises(ValueError, match="at least two views"):
        hold_out(replace(dataset, objects=(single,)))
    trainer = Trainer(dataset, SETTINGS)
    with pytest.raises(ValueError, match="diverged"):
        trainer.field.point_layer.weight.data.fill_(float("nan"))
        list(trainer.steps())
