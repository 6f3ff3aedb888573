"""A trained category model: the field, its code book and the scene it was trained in; one safetensors file."""

import copy
import hashlib
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from core.classifiers.viewpoint import ViewpointClassifier
from core.edits.edit import E, Edit
from core.geometry.camera import MAX_SIDE, Camera
from core.models.codes import CodeBook, Codes
from core.models.field import Field
from core.models.latents import CodeKind, Latents
from core.models.model_file import Words, read_model_file, rendering_tensors, singular, write_model_file
from core.models.occupied_cells import find_occupied_cells
from core.models.part_head import PartHead
from core.models.photo_detail import PhotoDetail
from core.models.view_bank import ViewBank
from core.runtime.files import atomic_file
from core.runtime.modes import usual_settings
from core.runtime.numbers import number, whole
from core.runtime.reading import reading

_MIN_BIAS_STD = 1e-3  # of a bias that hardly differs between training objects
_LARGEST = 1e6  # upper bound of lengths in scene units and px
_CELLS = "occupied_cells"  # the property's name, under which its value is kept


@dataclass(frozen=True, eq=False)
class Model:
    """A trained category. Rendering and fitting do not change it. Raises ``ValueError`` for unusable values."""

    field: Field
    codes: CodeBook
    extent: tuple[float, float, float]
    """Half the size of the scene's box along x, y, z, scene units. The box holds every training object."""
    category: str  # in the plural: "chairs"; '' if unknown
    image_size: int  # px, the size of the training images
    focal: float  # px at `image_size`
    distance: float  # scene units, of the training cameras
    white_from_network: bool = False
    """The network itself paints the white background (the authors' checkpoints): the last sample is always opaque."""
    viewpoint_classifier: ViewpointClassifier | None = None  # on the processor
    extends: tuple[str, ...] = ()  # fingerprints of the models that training started from, the latest first
    metres: float = 1.0  # length of a typical object's longest side
    stored_cells: Bool[Tensor, "x y z"] | None = None
    """:attr:`occupied_cells` from the model file; None: the file has none, compute them from the codes"""
    part_head: PartHead | None = None  # labels the parts of a mesh, on the processor; None: a mesh is one part
    view_bank: ViewBank | None = None
    """small views to compare photos with; None: the file has none, :mod:`core.photos.view_bank` computes it"""
    words: Words | None = None
    """of its directions; None: the file has none, :func:`core.editing.words.direction_words` finds them"""
    origin: "tuple[Callable[..., Model], tuple[str, ...]] | None" = field(default=None, init=False)
    """function and arguments that return a shipped model, by which its objects are pickled; None: pickle all of it"""

    def __post_init__(self) -> None:
        self._check_numbers()
        self._check_tensors()
        self.field.requires_grad_(False).eval()
        if self.viewpoint_classifier:
            self.viewpoint_classifier.requires_grad_(False).eval()

    def _check_numbers(self) -> None:
        sizes = {"focal": self.focal, "distance": self.distance, "metres": self.metres}
        sizes |= dict(zip("xyz", self.extent, strict=True))
        for name, size in sizes.items():
            if not 0 < number(size, name) < _LARGEST:
                raise ValueError(f"{name} of a model must be positive and below {_LARGEST:g}, got {size}")
        if not 1 <= whole(self.image_size, "image_size") <= MAX_SIDE:
            raise ValueError(f"image_size of a model is 1 to {MAX_SIDE} px, got {self.image_size}")

    def _check_tensors(self) -> None:
        latent = self.field.config.shape_latent, self.field.config.texture_latent
        if (self.codes.shapes.shape[-1], self.codes.textures.shape[-1]) != latent:
            raise ValueError(f"the codes do not fit the field, which needs {latent[0]} and {latent[1]} numbers")
        if self.codes.objects and not self.codes.valid:
            raise ValueError("all objects of the model collapsed in training")
        for name, weights in self.field.state_dict().items():
            if not bool(torch.isfinite(weights).all()):
                raise ValueError(f"the weights {name} of a model must be finite")
        if self.part_head and self.part_head.weight.shape[1] != self.field.config.width:
            raise ValueError("the part head does not fit the field")
        if self.view_bank and not self.view_bank.fits(self.codes):
            raise ValueError("the view bank does not fit the codes")

    def __getstate__(self) -> dict[str, object]:
        """Return the fields to pickle, without values cached from them."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def __getitem__(self, index: int) -> "Instance":
        """Return a training object. Raises ``ValueError`` for an index outside the book of codes."""
        return Instance(self, self.codes[index])

    @property
    def mean(self) -> "Instance":
        """The object with the mean shape and the mean texture."""
        return Instance(self, self.codes.mean)

    @property
    def first(self) -> "Instance":
        """The first training object that did not collapse; the mean object if there are none."""
        return self[self.codes.valid[0]] if self.codes.valid else self.mean

    def sample(self, generator: torch.Generator) -> "Instance":
        """Sample an object (:meth:`core.models.codes.CodeBook.sample`)."""
        return Instance(self, self.codes.sample(generator))

    @property
    def noun(self) -> str:
        """Name of one object of the category: "chair"."""
        return singular(self.category)

    @property
    def device(self) -> torch.device:
        """Device of the field."""
        return self.field.density_layer.weight.device

    @cached_property
    def soft(self) -> "Model":
        """The same model without contrast, for the search of fits.

        Fits through a field with contrast find worse codes: its gradients vanish beside surfaces.
        """
        if not self.field.config.contrast:
            return self
        field = copy.copy(self.field)
        field.config = replace(field.config, contrast=0.0)
        return replace(self, field=field)

    @cached_property
    def extent_tensor(self) -> Float[Tensor, "3"]:
        """``extent`` on the model's device."""
        return torch.tensor(self.extent, device=self.device)

    @property
    def pixel_offset(self) -> float:
        """Shift of rays from pixel centres to the left and up, px; 0.5 for the authors' models, else 0."""
        return 0.5 if self.white_from_network else 0.0

    @property
    def is_ablation(self) -> bool:
        """True for the paper's M1 and M2, which only the exact renderer supports."""
        return self.field.config.architecture != "codenerf"

    @cached_property
    def occupied_cells(self) -> Bool[Tensor, "cells cells cells"] | None:
        """Cells of the box that objects may occupy (:mod:`core.models.occupied_cells`), on the processor.

        None for M1 and M2, and for networks that paint the background: their field counts outside the box too. Read
        from the model file; computing missing cells takes seconds.
        """
        for _ in self.find_occupied_cells():
            pass
        return vars(self).get(_CELLS, self.stored_cells)

    def find_occupied_cells(self) -> Iterator[None]:
        """Compute :attr:`occupied_cells` in small steps, unless they are known; the property then returns at once."""
        if self.stored_cells is not None or _CELLS in vars(self):
            return
        cells = None
        if not (self.white_from_network or self.is_ablation):
            rows = sorted({self.codes.objects[index].shape for index in self.codes.valid})
            cells = yield from find_occupied_cells(self.field, self.codes.shapes[rows], self.extent_tensor)
            cells = cells.cpu()
        vars(self)[_CELLS] = cells  # where cached_property looks

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the field's weights and the codes: identifies the model in scenes."""
        digest = hashlib.sha256()
        for name, tensor in sorted(rendering_tensors(self.field, self.codes).items()):
            digest.update(name.encode())
            digest.update(tensor.numpy().tobytes())
        return digest.hexdigest()[:16]

    @property
    def look(self) -> tuple[Hashable, ...]:
        """All that renders of given codes depend on, as a comparable key."""
        return self.fingerprint, self.field.config, self.extent, self.white_from_network, self.device

    def shares_codes_with(self, fingerprint: str) -> bool:
        """Return True if this model can show codes of the model with this fingerprint: it is or extends that model."""
        return fingerprint in (self.fingerprint, *self.extends)

    @cached_property
    def bias_std(self) -> tuple[Float[Tensor, "blocks width"], Float[Tensor, "more_blocks width"]]:
        """Standard deviations of shape and texture biases over the training codes, the unit of offsets.

        Contrast does not change them.
        """
        with usual_settings(), torch.no_grad():  # cached
            biases = self.field.shape_bias(self.codes.shapes), self.field.texture_bias(self.codes.textures)
            shape, texture = (bias.std(0, unbiased=False).clamp_min(_MIN_BIAS_STD) for bias in biases)
            return shape, texture

    def fits(self, codes: Codes) -> bool:
        """Return whether codes, and those fitted to their photos, have the sizes that the field needs."""
        directions = len(self.codes.shape_space.std) if self.supports_motion else 0
        edits = all(edit.fits(self.extent, directions) for edit in codes.edits)
        return edits and all(map(self.field.fits, (codes, codes.detail.fitted) if codes.detail else (codes,)))

    @property
    def supports_motion(self) -> bool:
        """False for the authors' checkpoints and for M1 and M2, whose codes move alone."""
        return not (self.white_from_network or self.is_ablation)

    def biases(
        self, latents: Latents
    ) -> tuple[Float[Tensor, "*batch blocks width"], Float[Tensor, "*batch more_blocks width"]]:
        """Return the biases of the shape blocks and of the texture blocks: those of the codes, plus offsets."""
        shape, texture = self.field.biases(latents.shape, latents.texture)
        if latents.shape_offsets is not None:
            shape = shape + latents.shape_offsets[: shape.shape[-2]].to(shape) * self.bias_std[0]
        if latents.texture_offsets is not None:
            texture = texture + latents.texture_offsets[: texture.shape[-2]].to(texture) * self.bias_std[1]
        return shape, texture

    def camera(self, azimuth: float, elevation: float, distance: float | None = None) -> Camera:
        """Return a camera (rad, rad, scene units) with the training images' size and focal length.

        The distance is that of the training cameras by default.
        """
        size = self.image_size
        return Camera(azimuth, elevation, distance or self.distance, self.focal, size, size)

    def save(self, path: Path) -> None:
        """Write weights, codes and configuration as one safetensors file; an interrupted write leaves no file."""
        with atomic_file(path, Model.load) as partial:
            write_model_file(partial, self.__getstate__() | {"stored_cells": self.occupied_cells})

    @classmethod
    def load(cls, path: Path) -> "Model":
        """Read a model file. Raises ``ValueError`` naming the file if it is not one."""
        with reading(path, "a model file"):
            return cls(**read_model_file(path))


@dataclass(frozen=True, eq=False)
class Instance:
    """An object: a model with codes. Everything else that is known of an object is a function of this value.

    Compared by value: two are equal if their models render alike, and their codes and photos are equal.

    Example:
        >>> from core.models.library import load_model
        >>> model = load_model("chairs")
        >>> model[0].mixed(model[1], shape=0.0, texture=1.0) == model[0].with_texture(model[1])
        True
    """

    model: Model
    codes: Codes

    def __eq__(self, value: object) -> bool:
        if not isinstance(value, Instance):
            return NotImplemented
        return self is value or (self._hash == value._hash and self._is_like(value))

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the codes with the model, or with its origin."""
        if self.model.origin is None:
            return Instance, (self.model, self.codes)
        return _instance, (*self.model.origin, self.codes)

    def _is_like(self, second: "Instance") -> bool:
        if self.is_missing or second.is_missing:
            same = self.fingerprint == second.fingerprint
        else:
            same = self.model is second.model or self.model.look == second.model.look
        return same and self.codes == second.codes

    @cached_property
    def _hash(self) -> int:
        return hash((self.fingerprint, self.codes))

    @property
    def fingerprint(self) -> str:
        """The model's fingerprint, which identifies it in files."""
        return self.model.fingerprint

    @property
    def is_missing(self) -> bool:
        """True while the model is not open (:class:`core.models.missing.MissingInstance`)."""
        return False

    @property
    def detail(self) -> PhotoDetail | None:
        """Photos of a fitted object."""
        return self.codes.detail

    @property
    def fitted(self) -> "Instance":
        """The object as fitted to its photos, without them. Raises ``ValueError`` without photos."""
        if self.detail is None:
            raise ValueError("the object has no photos")
        return self.with_codes(Codes.of(self.detail.fitted))

    @property
    def is_sized(self) -> bool:
        """True if the object has another size than its natural one, or other proportions."""
        return bool(self.codes.edits_of("size"))

    @property
    def natural(self) -> "Instance":
        """The object in its natural size and proportions, edited or not."""
        return self.changed(edits=self.codes.edits_of("texture", "shape")) if self.is_sized else self

    @property
    def unpainted(self) -> "Instance":
        """The object in the network's colours."""
        return self.changed(edits=self.codes.edits_of("shape", "size"))

    @property
    def unmoved(self) -> "Instance":
        """The object in the space of its network, where no edit moves it."""
        edits = self.codes.edits_of("texture")
        return self if edits == self.codes.edits else self.changed(edits=edits)

    @property
    def unstretched(self) -> "Instance":
        """The object in its own space, before cameras see that stretched."""
        codes = self.codes
        return self if codes.edits == codes.field_edits else self.changed(edits=codes.field_edits)

    def local_camera(self, camera: Camera) -> Camera:
        """Return a camera as seen from the object's own space, before its size stretches that.

        The field, photo detail and outline know that space alone: a picture of a stretched object is one of the
        unstretched object through this camera.
        """
        return camera.stretched(self.codes.proportions)

    @property
    def biases(self) -> tuple[Float[Tensor, "blocks width"], Float[Tensor, "more_blocks width"]]:
        """Biases of the shape blocks and of the texture blocks."""
        return self.model.biases(self.codes)

    def with_codes(self, codes: Codes) -> "Instance":
        """Return an object of the same model."""
        return Instance(self.model, codes)

    def changed(self, **fields: Tensor | PhotoDetail | tuple[Edit, ...] | None) -> "Instance":
        """Return the object with other values of some fields of its codes (:class:`core.models.codes.Codes`)."""
        return self.with_codes(replace(self.codes, **fields))  # type: ignore[arg-type]

    def with_edits(self, kind: type[E], *edits: E) -> "Instance":
        """Return the object with these edits in place of those of the same kind."""
        return self.with_codes(self.codes.with_edits(kind, *edits))

    def with_detail(self, detail: PhotoDetail | None) -> "Instance":
        """Return the object with other photo detail; with None, in the colours of its codes alone."""
        return self.changed(detail=detail)

    def mixed(self, second: "Instance", shape: float, texture: float) -> "Instance":
        """Interpolate linearly between two objects.

        ``shape`` and ``texture`` are positions from 0 (this object) to 1 (the second). The photo detail is that of the
        nearer shape. Raises ``ValueError`` for an object of another model.
        """
        self._require_same_model(second)
        return self.with_codes(self.codes.mixed(second.codes, shape, texture))

    def taking(self, kind: CodeKind, source: "Instance") -> "Instance":
        """Return the object with the shape or the texture of another one.

        A shape comes with its photo detail and its size. Raises ``ValueError`` for an object of another model.
        """
        self._require_same_model(source)
        return self.with_codes(self.codes.taking(kind, source.codes))

    def with_shape(self, source: "Instance") -> "Instance":
        """Return the object with the shape of another one, as :meth:`taking`."""
        return self.taking("shape", source)

    def with_texture(self, source: "Instance") -> "Instance":
        """Return the object with the texture of another one, as :meth:`taking`."""
        return self.taking("texture", source)

    def moved(self, kind: CodeKind, by: Float[Tensor, "latent"]) -> "Instance":
        """Return the object with a vector added to its shape or texture code."""
        return self.changed(**{kind: getattr(self.codes, kind) + by})

    def _require_same_model(self, second: "Instance") -> None:
        if self.fingerprint != second.fingerprint:
            raise ValueError("objects of different models cannot be combined")


def _instance(load: Callable[..., Model], arguments: tuple[str, ...], codes: Codes) -> Instance:
    """Return an object that was pickled with the origin of its model."""
    return Instance(load(*arguments), codes)
