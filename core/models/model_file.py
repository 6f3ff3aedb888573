"""The file of a model: one safetensors file of weights and codes, whose metadata holds everything that is no tensor.

Reads and writes the values of :class:`core.models.model.Model` by the names of its fields.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Shaped
from safetensors.torch import save
from torch import Tensor

from core.classifiers.viewpoint import ViewpointClassifier
from core.models.architecture_variants import build_field
from core.models.codes import CodeBook, Entry
from core.models.field import Field
from core.models.field_config import FieldConfig
from core.models.latents import CodeKind
from core.models.occupied_cells import pack, unpack
from core.models.part_head import PartHead
from core.models.view_bank import ViewBank
from core.runtime.modes import isolated
from core.runtime.reading import parse_json, read_tensors, typed

_FORMAT = "codenerf-1"
_CELLS = "occupied_cells"
_CLASSIFIER = "viewpoint."  # prefix of the viewpoint classifier's tensors
_BANK = "view_bank."  # prefix of the view bank's tensors
_PARTS = "parts.weight", "parts.bias"

Words = dict[CodeKind, tuple[str, ...]]  # for the first directions of shape and of texture, such as "taller"


class _Metadata(NamedTuple):
    """The metadata of a model file: the values of a model that are not tensors."""

    config: FieldConfig
    objects: tuple[tuple[str, int, int], ...]
    extent: tuple[float, float, float]
    category: str
    image_size: int
    focal: float
    distance: float
    collapsed: frozenset[int] = frozenset()
    white_from_network: bool = False
    extends: tuple[str, ...] = ()
    metres: float = 1.0
    parts: tuple[str, ...] = ()  # names of the part head's parts
    words: Words | None = None


_PLAIN = ("extent", "category", "image_size", "focal", "distance", "metres", "white_from_network", "extends")
"""fields of a model that its metadata holds as they are, and ``words``"""


def write_model_file(path: Path, values: Mapping[str, Any]) -> None:
    """Write the values of a model's fields."""
    head = values["part_head"]
    metadata = {
        "config": asdict(values["field"].config),
        "objects": [list(entry) for entry in values["codes"].objects],
        "collapsed": sorted(values["codes"].collapsed),
    }
    metadata |= {name: values[name] for name in _PLAIN}
    metadata |= {"parts": head.names if head else (), "words": values["words"]}
    path.write_bytes(save(_all_tensors(values), metadata={"format": _FORMAT, "model": json.dumps(metadata)}))


@isolated
def read_model_file(path: Path) -> dict[str, Any]:
    """Read the values of a model's fields. Raises ``ValueError`` if the file is not one of this program."""
    texts, tensors = read_tensors(path)
    if "model" not in texts:
        raise ValueError("it is not a model file of this program")
    metadata = typed(_Metadata, parse_json(texts["model"]), name="model")
    values = {name: getattr(metadata, name) for name in (*_PLAIN, "words")}
    return values | _pop_values(tensors, metadata)


def rendering_tensors(field: Field, codes: CodeBook) -> dict[str, Tensor]:
    """Return the tensors that determine renders, by name. A model's fingerprint is their hash."""
    tensors = {f"field.{name}": tensor for name, tensor in field.state_dict().items()}
    tensors |= {"codes.shapes": codes.shapes, "codes.textures": codes.textures}
    return {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}


def _pop_values(tensors: dict[str, Tensor], metadata: _Metadata) -> dict[str, Any]:
    """Remove a file's tensors and return the values that a model makes of them, by field."""
    with torch.random.fork_rng(devices=[]):  # networks draw initial weights
        field = build_field(metadata.config)
        classifier = _pop_classifier(tensors)
    shapes = tensors.pop("codes.shapes").float()
    textures = tensors.pop("codes.textures").float()
    cells = tensors.pop(_CELLS, None)
    head = PartHead(metadata.parts, *(tensors.pop(name).float() for name in _PARTS)) if metadata.parts else None
    views = _pop_prefixed(tensors, _BANK)
    bank = ViewBank.from_tensors(views, metadata.distance) if views else None
    field.load_state_dict({name.removeprefix("field."): tensor.float() for name, tensor in tensors.items()})
    objects = tuple(Entry(*entry) for entry in metadata.objects)
    return {
        "field": field,
        "codes": CodeBook(shapes, textures, objects, metadata.collapsed),
        "viewpoint_classifier": classifier,
        "stored_cells": None if cells is None else unpack(cells),
        "part_head": head,
        "view_bank": bank,
    }


def _pop_classifier(tensors: dict[str, Tensor]) -> ViewpointClassifier | None:
    """Remove the viewpoint classifier's tensors from a file's and return the classifier; None if it has none."""
    state = _pop_prefixed(tensors, _CLASSIFIER)
    if not state:
        return None
    classifier = ViewpointClassifier()
    classifier.load_state_dict({name: tensor.float() for name, tensor in state.items()})
    return classifier


def _pop_prefixed(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """Remove the tensors whose names begin with a prefix; return them by the rest of their names."""
    stored = [name for name in tensors if name.startswith(prefix)]
    return {name.removeprefix(prefix): tensors.pop(name) for name in stored}


def _all_tensors(values: Mapping[str, Any]) -> dict[str, Tensor]:
    """Return all tensors to save: the field in float32, codes in float16 if lossless, and the optional ones."""
    tensors = rendering_tensors(values["field"], values["codes"])
    tensors |= {name: _halved(tensor) for name, tensor in tensors.items() if name.startswith("codes.")}
    if classifier := values["viewpoint_classifier"]:
        tensors |= {_CLASSIFIER + name: tensor.half() for name, tensor in classifier.state_dict().items()}
    if (cells := values["stored_cells"]) is not None:
        tensors[_CELLS] = pack(cells)
    if head := values["part_head"]:
        tensors |= dict(zip(_PARTS, (head.weight, head.bias), strict=True))
    if bank := values["view_bank"]:
        tensors |= {_BANK + name: tensor for name, tensor in bank.to_tensors().items()}
    return tensors


def _halved(tensor: Shaped[Tensor, "*shape"]) -> Shaped[Tensor, "*shape"]:
    """Return the tensor in half precision if that has the same values."""
    half = tensor.half()
    return half if torch.equal(half.float(), tensor) else tensor


def singular(category: str) -> str:
    """Return the noun for one object of a category.

    Example:
        >>> singular("chairs")
        'chair'
    """
    return category.removesuffix("s")
