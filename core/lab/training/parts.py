"""What tells parts of objects apart, learned from the generated objects that a model was trained on.

Their generators know wheels from body and seat from legs. The surface of the field has the part of the nearest place
of the generated shape.
"""

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from core.export.mesh import extract_mesh
from core.export.normals import face_normals
from core.lab.datasets.procedural.solids import Shape
from core.lab.datasets.procedural.table import ProceduralObject, shape_of
from core.models.codes import Codes
from core.models.model import Model
from core.models.part_head import PartHead
from core.rendering.folded_field import FoldedField
from core.streams import run_to_end

PARTS = {"cars": ("body", "wheels", "glass"), "chairs": ("seat", "back", "legs", "arms")}
"""The names of each category's parts; what is no other part is the first."""
_RESOLUTION = 96  # cells along the longest side of the surfaces that are learned from
_PLACES = 1000  # of each object's surface
_SAMPLES = 60000  # of the generated shape's surface
_DEPTH = 0.004  # scene units below the surface
_SHELL_BACK = 0.1  # m above its legs: from there on a bent shell is the back
_STEPS, _WEIGHT_DECAY = 60, 1e-4  # of L-BFGS; of the squared norm of the weights

Places = tuple[Float[Tensor, "places width"], Int[Tensor, "places"]]  # features of the field, and parts as indices


def labelled_places(model: Model, count: int) -> Iterator[Places]:
    """Places on about ``count`` generated objects of different shapes that the model was trained on, object by object.

    Raises ``ValueError`` where it was trained on none, or its category has no parts.
    """
    if model.category not in PARTS:
        raise ValueError(f"only the parts of {' and '.join(PARTS)} are known, not of {model.category or 'anything'}")
    named = {index: ProceduralObject.named(model.codes.objects[index].name) for index in model.codes.valid}
    shapes = {item.shape: index for index, item in named.items() if item and item.category == model.category}
    if not shapes:
        raise ValueError("the model was trained on no generated object, whose parts would be known")
    generator = np.random.default_rng(0)
    for seed in sorted(shapes)[:: max(1, len(shapes) // count)]:
        yield _places(model, model.codes[shapes[seed]], shape_of(model.category, seed), generator)


def fit_part_head(model: Model, places: list[Places]) -> PartHead:
    """The linear classifier of these places by logistic regression."""
    features, part = (torch.cat(values) for values in zip(*places, strict=True))
    mean, std = features.mean(0), features.std(0) + 1e-3
    features = (features - mean) / std
    names = PARTS[model.category]
    weight = torch.zeros(len(names), features.shape[1], requires_grad=True)
    bias = torch.zeros(len(names), requires_grad=True)
    optimiser = torch.optim.LBFGS([weight, bias], max_iter=_STEPS, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimiser.zero_grad()
        value = functional.cross_entropy(features @ weight.T + bias, part) + _WEIGHT_DECAY * weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    with torch.no_grad():
        return PartHead(names, weight / std, bias - weight @ (mean / std))


def _places(model: Model, codes: Codes, shape: Shape, generator: np.random.Generator) -> Places:
    """Places on the field's surface, spread evenly, each with the part of the nearest of the generated surface."""
    mesh = run_to_end(extract_mesh(model, codes, _RESOLUTION))
    normals = face_normals(mesh.vertices, mesh.faces)
    places, _, facing = _spread(mesh.vertices[mesh.faces], normals, _PLACES, generator)
    triangles, part = _labelled(shape, PARTS[model.category])
    turned = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    known, owner, _ = _spread(triangles, turned, _SAMPLES, generator)
    nearest = cKDTree(known).query(places)[1]
    folded = FoldedField(model, codes)
    with torch.inference_mode():
        inside = torch.from_numpy(places - _DEPTH * facing).float()
        features = folded.density(inside.to(folded.device))[1].float().cpu()
    return features.clone(), torch.from_numpy(part[owner[nearest]])


def _labelled(shape: Shape, names: tuple[str, ...]) -> tuple[Float[np.ndarray, "faces 3 3"], Int[np.ndarray, "faces"]]:
    """A generated shape's triangles, and each one's part."""
    triangles, parts = [], []
    legs = [part.solid.vertices[:, 2].max() for part in shape.parts if part.of == "legs"]
    for part in shape.parts:
        corners = part.solid.vertices[part.solid.faces]
        own = part.of or (part.label if part.label in names else names[0])
        if own == "shell":
            back = corners[:, :, 2].mean(1) > max(legs) + _SHELL_BACK * shape.metre
            parts.append(np.where(back, names.index("back"), names.index("seat")))
        else:
            parts.append(np.full(len(corners), names.index(own)))
        triangles.append(corners)
    return np.concatenate(triangles), np.concatenate(parts)


def _spread(
    triangles: Float[np.ndarray, "faces 3 3"],
    normals: Float[np.ndarray, "faces 3"],
    count: int,
    generator: np.random.Generator,
) -> tuple[Float[np.ndarray, "count 3"], Int[np.ndarray, "count"], Float[np.ndarray, "count 3"]]:
    """Random places on triangles, as many as fits their area, which triangle each is on, and its unit normal."""
    area = np.linalg.norm(normals, axis=1)
    chosen = generator.choice(len(triangles), count, p=area / area.sum())
    weights = generator.dirichlet((1, 1, 1), count)[..., None]
    return (weights * triangles[chosen]).sum(1), chosen, normals[chosen] / area[chosen, None]
