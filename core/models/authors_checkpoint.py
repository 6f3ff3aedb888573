"""Reads checkpoints written by the authors' own trainer (github.com/wbjang/code-nerf)."""

import json
import pickle
import statistics
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from core.models.codes import CodeBook, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.model import Model

_LAYERS = {
    "encoding_xyz.0": "point_layer",
    "encoding_shape": "feature_layer",
    "sigma.0": "density_layer",
    "encoding_viewdir.0": "direction_layer",
    "rgb.0": "colour_hidden",
    "rgb.2": "colour_layer",
}


_UNREADABLE = (AttributeError, EOFError, KeyError, OSError, pickle.UnpicklingError, RuntimeError, TypeError, ValueError)
_CELLS = 12
"""Points along each axis at which density is evaluated to find collapsed objects."""
_COLLAPSED_BELOW = 0.025
"""Share of the median object's solid volume. In their 500 cars, collapsed ones have at most 0.015 and the smallest
whole car 0.043."""


def load_authors(path: Path, config: Path | None = None) -> Model:
    """A model from ``models.pth`` and ``hpam.json``; nothing in the files is executed.

    Their network paints the white background itself (``white_from_network``) and its colours are unbounded. Objects
    that collapsed in training are found by their emptiness (:attr:`core.models.codes.CodeBook.collapsed`). Raises
    ``ValueError`` naming the file where one of the two is missing or holds something else.

    Args:
        config: ``hpam.json``; beside the checkpoint unless given.
    """
    settings_path = config or path.with_name("hpam.json")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        settings = json.loads(settings_path.read_text())
        sizes = settings["net_hyperparams"]
        network = FieldConfig(
            width=sizes["W"],
            shape_blocks=sizes["shape_blocks"],
            texture_blocks=sizes["texture_blocks"],
            shape_latent=sizes["latent_dim"],
            texture_latent=sizes["latent_dim"],
            position_frequencies=sizes["num_xyz_freq"],
            direction_frequencies=sizes["num_dir_freq"],
            density_scale=1.0,
            bounded_colour=False,
        )
        field = Field(network)
        field.load_state_dict(_rename_tensors(state["model_params"]))
        shapes, textures = state["shape_code_params"]["weight"], state["texture_code_params"]["weight"]
        middle = (settings["near"] + settings["far"]) / 2
        category = settings["data"]["cat"].removeprefix("srn_")
    except FileNotFoundError as error:
        raise ValueError(f"no such file: {error.filename}") from None
    except _UNREADABLE as error:
        raise ValueError(f"{path} is not a checkpoint of the authors' trainer: {error}") from None
    names = tuple(Entry(f"{index:04d}", index, index) for index in range(len(shapes)))
    codes = CodeBook(shapes.float(), textures.float(), names, _collapsed(field, shapes.float()))
    # Their rays run 0.5 to either side of the middle: the box that holds every object is that of diagonal 1.
    return Model(field, codes, (0.5, 0.5, 0.5), category, 128, 131.25, middle, white_from_network=True)


@torch.no_grad()
def _collapsed(field: Field, shapes: Float[Tensor, "objects latent"]) -> frozenset[int]:
    """Objects that show next to nothing.

    The share of light that an interval of their training takes is squared before it is averaged over the box: what is
    solid counts, mist hardly does.
    """
    axis = (torch.arange(_CELLS) + 0.5) / _CELLS - 0.5
    points = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    biases = field.shape_bias(shapes)
    solid = [float((-torch.expm1(-field.density(points, bias)[0] / 64)).square().mean()) for bias in biases]
    least = _COLLAPSED_BELOW * statistics.median(solid)
    return frozenset(index for index, amount in enumerate(solid) if amount < least)


def _rename_tensors(state: dict[str, Tensor]) -> dict[str, Tensor]:
    renamed = {}
    for name, tensor in state.items():
        layer, kind = name.rsplit(".", 1)
        if layer in _LAYERS:
            target = _LAYERS[layer]
        else:  # e.g. shape_latent_layer_1.0, texture_layer_1.0
            part, _, number = layer.removesuffix(".0").rpartition("_layer_")
            part = part if part.endswith("latent") else f"{part}_block"
            target = f"{part}.{int(number) - 1}"
        renamed[f"{target}.{kind}"] = tensor
    return renamed
