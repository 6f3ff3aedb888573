"""Train a part head by another model's, on the objects that both were trained on.

The other model labels the triangles of its surfaces. Each point on the new model's surface takes the part of the
nearest triangle.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from core.export.mesh import extract_mesh
from core.export.triangle_mesh import face_normals
from core.lab.datasets.srn import evenly_spaced
from core.models.model import Instance, Model
from core.models.part_head import PartHead
from core.rendering.folded_field import FoldedField
from core.streams import run_to_end

_RESOLUTION = 96  # cells along the longest side of both surfaces
_PLACES = 1000  # points on each object's surface
_DEPTH = 0.004  # scene units below the surface
_STEPS = 60  # steps of L-BFGS
_WEIGHT_DECAY = 1e-4  # factor of the squared norm of the weights in the loss

Places = tuple[Float[Tensor, "places width"], Int[Tensor, "places"]]  # field features, part indices


def labelled_places(model: Model, teacher: Model, count: int) -> Iterator[Places]:
    """Yield labelled points of at most ``count`` objects of different shapes, found at the teacher by their names.

    Raises ``ValueError`` if the teacher has no part head, or if the models share no object.
    """
    if not teacher.part_head:
        raise ValueError("the model that labels parts has no part head")
    labelled = {teacher.codes.objects[index].name: index for index in teacher.codes.valid}
    shapes = {model.codes.objects[index].shape: index for index in model.codes.valid}
    shared = [index for index in shapes.values() if model.codes.objects[index].name in labelled]
    if not shared:
        raise ValueError("the two models were trained on no common object")
    generator = np.random.default_rng(0)
    for index in evenly_spaced(shared, count):
        name = model.codes.objects[index].name
        yield _places(model[index], *_labelled_triangles(teacher[labelled[name]]), generator)


def fit_part_head(names: tuple[str, ...], places: Sequence[Places]) -> PartHead:
    """Fit the linear classifier to labelled points by logistic regression."""
    features, labels = (torch.cat(values) for values in zip(*places, strict=True))
    mean = features.mean(0)
    std = features.std(0) + 1e-3
    features = (features - mean) / std
    weight = torch.zeros(len(names), features.shape[1], requires_grad=True)
    bias = torch.zeros(len(names), requires_grad=True)
    optimiser = torch.optim.LBFGS([weight, bias], max_iter=_STEPS, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimiser.zero_grad()
        value = functional.cross_entropy(features @ weight.T + bias, labels) + _WEIGHT_DECAY * weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    with torch.no_grad():
        return PartHead(names, weight / std, bias - weight @ (mean / std))


def _labelled_triangles(instance: Instance) -> tuple[Float[np.ndarray, "faces 3"], Int[np.ndarray, "faces"]]:
    """Return the middles of the teacher's triangles, and their parts."""
    assert instance.model.part_head
    mesh = run_to_end(extract_mesh(instance, _RESOLUTION))
    names, counts = zip(*mesh.part_counts, strict=True)
    labels = np.repeat([instance.model.part_head.names.index(name) for name in names], counts)
    return mesh.vertices[mesh.faces].mean(1), labels


def _places(
    instance: Instance,
    middles: Float[np.ndarray, "faces 3"],
    labels: Int[np.ndarray, "faces"],
    generator: np.random.Generator,
) -> Places:
    """Sample points evenly on the field's surface, each with the label of the nearest labelled triangle."""
    mesh = run_to_end(extract_mesh(instance, _RESOLUTION))
    normals = face_normals(mesh.vertices, mesh.faces)
    area = np.linalg.norm(normals, axis=1)
    sampled = generator.choice(len(area), _PLACES, p=area / area.sum())
    weights = generator.dirichlet((1, 1, 1), _PLACES)[..., None]
    points = (weights * mesh.vertices[mesh.faces[sampled]]).sum(1)
    inside = torch.from_numpy(points - _DEPTH * normals[sampled] / area[sampled, None]).float()
    folded = FoldedField.of(instance)
    with torch.inference_mode():
        features = folded.density(inside.to(folded.device))[1].float().cpu()
    return features.clone(), torch.from_numpy(labels[cKDTree(middles).query(points)[1]])
