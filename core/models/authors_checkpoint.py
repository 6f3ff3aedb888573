"""Reads checkpoints written by the authors' own trainer (github.com/wbjang/code-nerf)."""

import statistics
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from core.models.codes import CODE_KINDS, CodeBook, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.model import Model
from core.runtime.modes import isolated
from core.runtime.reading import open_zip, read_json, reading, typed

_LAYERS = {
    "encoding_xyz.0": "point_layer",
    "encoding_shape": "feature_layer",
    "sigma.0": "density_layer",
    "encoding_viewdir.0": "direction_layer",
    "rgb.0": "colour_hidden",
    "rgb.2": "colour_layer",
}
_PARALLEL = "module."  # prefix that torch's DataParallel adds to tensor names
_CELLS = 12  # along each axis; density is evaluated at their centres to find collapsed objects
_COLLAPSED_BELOW = 0.025
"""Solid volume, relative to the median object's, below which an object counts as collapsed.

Among the authors' cars, collapsed objects have at most 0.015 and whole ones at least 0.043."""


class _Hyperparameters(NamedTuple):
    """Sizes of the network, under the authors' names."""

    W: int
    shape_blocks: int
    texture_blocks: int
    latent_dim: int
    num_xyz_freq: int
    num_dir_freq: int

    @property
    def config(self) -> FieldConfig:
        """These sizes as a :class:`FieldConfig`, with the authors' conventions for density and colour."""
        return FieldConfig(
            width=self.W,
            shape_blocks=self.shape_blocks,
            texture_blocks=self.texture_blocks,
            shape_latent=self.latent_dim,
            texture_latent=self.latent_dim,
            position_frequencies=self.num_xyz_freq,
            direction_frequencies=self.num_dir_freq,
            density_scale=1.0,
            bounded_colour=False,
        )


class _Data(NamedTuple):
    cat: str


class _Settings(NamedTuple):
    """The entries of ``hpam.json`` that are read."""

    net_hyperparams: _Hyperparameters
    data: _Data
    near: float
    far: float


@isolated
def load_authors(path: Path, config: Path | None = None) -> Model:
    """Read a model from ``models.pth`` and ``hpam.json``; nothing in the files is executed.

    The authors' network paints the white background itself (``white_from_network``) and its colours are unbounded.
    Objects that collapsed in training are marked (:attr:`core.models.codes.CodeBook.collapsed`). Raises ``ValueError``
    naming the file that is missing or that the authors' trainer did not write.

    Args:
        config: ``hpam.json``; by default beside the checkpoint.
    """
    settings_path = config or path.with_name("hpam.json")
    for file in (path, settings_path):
        if not file.is_file():
            raise ValueError(f"{file}: no such file; a checkpoint is models.pth with hpam.json beside it")
    with reading(path, "a checkpoint of the authors' trainer"):
        state = _load_tensors(path)
        network = _rename_tensors(_tensors(state, "model_params"))
        shapes, textures = (_codes(_tensors(state, f"{kind}_code_params")) for kind in CODE_KINDS)
    with reading(settings_path, "settings of the authors' trainer"):
        settings = typed(_Settings, read_json(settings_path), name="hpam")
        with torch.random.fork_rng(devices=[]):  # a network draws initial weights
            field = Field(settings.net_hyperparams.config)
    with reading(path, "a checkpoint of the authors' trainer"):
        field.load_state_dict(network)
        if len(shapes) != len(textures):
            raise ValueError(f"it has {len(shapes)} shape codes and {len(textures)} texture codes")
        return _to_model(field, shapes, textures, settings)


def _to_model(field: Field, shapes: Tensor, textures: Tensor, settings: "_Settings") -> Model:
    category = settings.data.cat.removeprefix("srn_")
    middle = (settings.near + settings.far) / 2
    names = tuple(Entry(f"{index:04d}", index, index) for index in range(len(shapes)))
    codes = CodeBook(shapes, textures, names, _collapsed(field, shapes))
    # The authors' rays run 0.5 to either side of the middle: a box of diagonal 1 holds every object.
    return Model(field, codes, (0.5, 0.5, 0.5), category, 128, 131.25, middle, white_from_network=True)


def _load_tensors(path: Path) -> Any:
    """Load the values that torch saved; nothing in the file is executed."""
    if zipfile.is_zipfile(path):
        with open_zip(path):  # refuses archives larger than memory
            pass
    return torch.load(path, map_location="cpu", weights_only=True)


def _tensors(state: Any, name: str) -> dict[str, Tensor]:
    """Return one table of a checkpoint: its tensors by name, without the prefix of DataParallel."""
    table = state.get(name) if isinstance(state, dict) else None
    if not isinstance(table, dict) or not all(isinstance(tensor, Tensor) for tensor in table.values()):
        raise ValueError(f"it has no table {name} of tensors")
    return {str(key).removeprefix(_PARALLEL): tensor for key, tensor in table.items()}


def _codes(state: dict[str, Tensor]) -> Float[Tensor, "objects latent"]:
    if "weight" not in state or state["weight"].ndim != 2:
        raise ValueError("it has no table of codes")
    return state["weight"].float()


@torch.no_grad()
def _collapsed(field: Field, shapes: Float[Tensor, "objects latent"]) -> frozenset[int]:
    """Return the indices of objects that are nearly empty.

    The solid volume is the mean over the box of the squared opacity of one training interval: fog hardly counts.
    """
    axis = (torch.arange(_CELLS) + 0.5) / _CELLS - 0.5
    points = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    biases = field.shape_bias(shapes)
    solid = [float((-torch.expm1(-field.density(points, bias)[0] / 64)).square().mean()) for bias in biases]
    threshold = _COLLAPSED_BELOW * statistics.median(solid)
    return frozenset(index for index, amount in enumerate(solid) if amount < threshold)


def _rename_tensors(state: dict[str, Tensor]) -> dict[str, Tensor]:
    renamed = {}
    for name, tensor in state.items():
        layer, kind = name.rsplit(".", 1)
        if layer in _LAYERS:
            target = _LAYERS[layer]
        else:  # e.g. shape_latent_layer_1.0, texture_layer_1.0
            stage, _, number = layer.removesuffix(".0").rpartition("_layer_")
            stage = stage if stage.endswith("latent") else f"{stage}_block"
            target = f"{stage}.{int(number) - 1}"
        renamed[f"{target}.{kind}"] = tensor
    return renamed
