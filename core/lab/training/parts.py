"""Train a part head from the generated objects that a model was trained on.

The generators label parts of shapes. Each point on the field's surface takes the part of the nearest point on the
generated shape.
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
"""The names of each category's parts; the first takes the rest of the object."""
_RESOLUTION = 96  # cells along the longest side of the training surfaces
_PLACES = 1000  # points on each object's surface
_SAMPLES = 60000  # points on the generated shape's surface
_DEPTH = 0.004  # scene units below the surface
_SHELL_BACK = 0.1  # m above its legs, from where a bent shell is the back
_STEPS, _WEIGHT_DECAY = 60, 1e-4  # of L-BFGS; of the squared norm of the weights

Places = tuple[Float[Tensor, "places width"], Int[Tensor, "places"]]  # field features, part indices


def labelled_places(model: Model, count: int) -> Iterator[Places]:
    """Yield labelled points of about ``count`` generated training objects of different shapes, object by object.

    Raises ``ValueError`` if there are none, or if the category has no parts.
    """
    if model.category not in PARTS:
        raise ValueError(
            f"parts can be learned for {' and '.join(PARTS)} only, not for {model.category or 'this model'}"
        )
    named = {index: ProceduralObject.named(model.codes.objects[index].name) for index in model.codes.valid}
    shapes = {item.shape: index for index, item in named.items() if item and item.category == model.category}
    if not shapes:
        raise ValueError("the model was not trained on generated objects, which have labelled parts")
    generator = np.random.default_rng(0)
    for seed in sorted(shapes)[:: max(1, len(shapes) // count)]:
        yield _places(model, model.codes[shapes[seed]], shape_of(model.category, seed), generator)


def fit_part_head(model: Model, places: list[Places]) -> PartHead:
    """Fit the linear classifier to labelled points by logistic regression."""
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
    """Sample points evenly on the field's surface, each with the part of the nearest point on the generated surface."""
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
    """Return a generated shape's triangles and their parts."""
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
    """Sample points on triangles by area; return points, triangle indices and unit normals."""
    area = np.linalg.norm(normals, axis=1)
    chosen = generator.choice(len(triangles), count, p=area / area.sum())
    weights = generator.dirichlet((1, 1, 1), count)[..., None]
    return (weights * triangles[chosen]).sum(1), chosen, normals[chosen] / area[chosen, None]
