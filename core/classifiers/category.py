"""The category classifier: which category an image of one object shows, or none that has a model."""

import json
from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from safetensors.torch import save
from torch import Tensor

from core.classifiers.crops import CropClassifier, crop_to_object
from core.runtime.files import atomic_file
from core.runtime.reading import parse_json, read_tensors, reading, typed


class CategoryClassifier(CropClassifier):
    """A classifier whose classes are categories, and last "none of them"."""

    def __init__(self, categories: Sequence[str]) -> None:
        super().__init__(len(categories) + 1)
        self.categories = tuple(categories)

    def save(self, path: Path) -> None:
        """Write weights, in half precision, and categories as one safetensors file."""
        state = {name: tensor.half().contiguous() for name, tensor in self.state_dict().items()}
        with atomic_file(path, CategoryClassifier.load) as partial:
            partial.write_bytes(save(state, metadata={"categories": json.dumps(self.categories)}))

    @classmethod
    def load(cls, path: Path) -> "CategoryClassifier":
        """Read a file of :meth:`save`. Raises ``ValueError`` naming the file where it is none."""
        with reading(path, "a category classifier"):
            metadata, tensors = read_tensors(path)
            classifier = cls(typed(tuple[str, ...], parse_json(metadata["categories"]), name="categories"))
            classifier.load_state_dict({name: tensor.float() for name, tensor in tensors.items()})
            return classifier.requires_grad_(False).eval()


@torch.no_grad()
def predict_category(
    classifier: CategoryClassifier, pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> dict[str, float]:
    """The probability of each category; what they lack to 1 is that of "none of them".

    Args:
        pixels: 0..1.
        mask: True on the object.
    """
    probability = classifier(crop_to_object(pixels, mask)[None])[0].softmax(-1)
    return dict(zip(classifier.categories, probability.tolist(), strict=False))
