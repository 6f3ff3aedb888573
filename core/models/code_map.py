"""From the codes of a model to those of one that its training went on to."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from core.models.codes import CodeBook, Codes

_STAY = 0.01
"""How much the squared change of a code counts against the squared error, in the fit."""


@dataclass(frozen=True, eq=False)
class CodeMap:
    """An affine map of codes, fitted to the objects that both models were trained on."""

    shape: Float[Tensor, "shape_rows shape_latent"]
    """one row for each number of a code; the last is added"""
    texture: Float[Tensor, "texture_rows texture_latent"]

    @classmethod
    def fitted(cls, former: CodeBook, now: CodeBook) -> "CodeMap":
        """The map of the objects that both books have, by least squares; it leaves alone what they do not tell of."""
        names = [name for name in former.index if name in now.index]
        before, after = ([book[book.index[name]] for name in names] for book in (former, now))
        return cls(
            _affine([codes.shape for codes in before], [codes.shape for codes in after]),
            _affine([codes.texture for codes in before], [codes.texture for codes in after]),
        )

    def __call__(self, codes: Codes) -> Codes:
        """The codes that look now as these did, a photo's detail included."""
        shape, texture = self._shape_of(codes.shape), self._texture_of(codes.texture)
        detail = codes.detail
        if detail:
            detail = replace(detail, shape=self._shape_of(detail.shape), texture=self._texture_of(detail.texture))
        return Codes(shape, texture, detail)

    def _shape_of(self, code: Float[Tensor, "*batch shape_latent"]) -> Float[Tensor, "*batch shape_latent"]:
        return code @ self.shape[:-1] + self.shape[-1]

    def _texture_of(self, code: Float[Tensor, "*batch texture_latent"]) -> Float[Tensor, "*batch texture_latent"]:
        return code @ self.texture[:-1] + self.texture[-1]


def _affine(
    former: list[Float[Tensor, "latent"]], now: list[Float[Tensor, "latent"]]
) -> Float[Tensor, "latent_and_one latent"]:
    """Least squares on how codes change, in double precision."""
    codes, step = torch.stack(former).double(), (torch.stack(now) - torch.stack(former)).double()
    known = functional.pad(codes, (0, 1), value=1.0)
    stay = _STAY * torch.eye(known.shape[1], dtype=known.dtype)
    change = torch.linalg.solve(known.T @ known + stay, known.T @ step)
    return (change + torch.eye(*change.shape, dtype=known.dtype)).float().contiguous()
