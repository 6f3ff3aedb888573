"""Small convolutional classifiers of an image of one object, cropped to it."""

from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from core.geometry.pixels import bounding_box

SIDE = 48  # px, of the input
CROP_MARGIN = 1.12  # side of the square input, over the longer side of the object's box
_CHANNELS = (20, 40, 64, 80)
_BOTTLENECK = 32
_HIDDEN = 96


class CropClassifier(nn.Module):
    """Convolutional network over (images, 4, SIDE, SIDE) from :func:`crop_to_object`: rgb on white and mask, 0..1."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        sizes = (4, *_CHANNELS)
        self.layers = nn.ModuleList(nn.Conv2d(one, other, 3, 2, 1) for one, other in pairwise(sizes))
        self.fewer = nn.Conv2d(sizes[-1], _BOTTLENECK, 1)
        self.hidden = nn.Linear(_BOTTLENECK * (SIDE // 2 ** len(_CHANNELS)) ** 2, _HIDDEN)
        self.last = nn.Linear(_HIDDEN, classes)

    def forward(self, images: Float[Tensor, "images 4 side side"]) -> Float[Tensor, "images classes"]:
        """Return logits; applies dropout while training."""
        y = 2 * images - 1
        for layer in (*self.layers, self.fewer):
            y = layer(y).relu()
        y = self.hidden(y.flatten(1)).relu()
        return self.last(functional.dropout(y, 0.1, self.training))


def crop_to_object(
    pixels: Float[Tensor, "height width 3"], mask: Bool[Tensor, "height width"]
) -> Float[Tensor, "4 side side"]:
    """Crop an image to a square around the object, as the network's input: rgb on white and the mask."""
    left, top, right, bottom = bounding_box(mask)
    middle, half = ((top + bottom) / 2, (left + right) / 2), CROP_MARGIN * max(right - left, bottom - top) / 2
    steps = (torch.arange(2 * SIDE) + 0.5) / SIDE - 1
    y, x = ((one + half * steps) / length * 2 - 1 for one, length in zip(middle, mask.shape, strict=True))
    grid = torch.stack(torch.broadcast_tensors(x[None, :], y[:, None]), -1)
    inside = mask[..., None].float()
    seen = torch.cat(((pixels - 1) * inside, inside), -1).movedim(-1, 0)[None]
    found = functional.avg_pool2d(functional.grid_sample(seen, grid[None], align_corners=False), 2)[0]
    return torch.cat((found[:3] + 1, found[3:]))
