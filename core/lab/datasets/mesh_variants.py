"""Variants of a mesh: other proportions and other colours, each an identity of its own."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.cluster.vq import kmeans2

from core.lab.datasets.procedural.paint import any_colour
from core.lab.datasets.rasteriser import Surface

_COLOURS = 6  # At most as many groups of colour, taken as the parts of a mesh.
_STRETCH = 0.16
"""Largest logarithm of the factor by which an axis is stretched, and of that by which its two halves differ."""
_TEXELS = 1024  # px; larger textures are shrunk to this before they are recoloured.

Recolouring = Callable[[Float[np.ndarray, "*colours 3"]], Float[np.ndarray, "*colours 3"]]


def pairs(variants: int) -> tuple[tuple[int, int], ...]:
    """The pairs (shape, recolouring) that are rendered of a mesh with so many deformed shapes beside its own.

    With n shapes there are n - 1 recolourings, each shape has one or two of them, and neighbouring shapes share one:
    about half of the table. (0, 0) is the mesh as it is.
    """
    colourings = max(1, variants)
    filled = [(shape, colours) for shape in range(colourings) for colours in (shape, shape + 1) if colours < colourings]
    return (*filled, (variants, 0)) if variants else ((0, 0),)


def deformed(surfaces: Sequence[Surface], name: str, shape: int) -> tuple[Surface, ...]:
    """The object in other proportions; the mesh as it is for shape 0.

    Length, width and height are stretched, and along length and height the part below a random place and the
    part above it differently. The object stays symmetric.
    """
    if shape == 0:
        return tuple(surfaces)
    generator = _generator(name, 1, shape)
    used = np.vstack([surface.vertices for surface in surfaces])
    low, high = used.min(0), used.max(0)
    knee = low + generator.uniform(0.35, 0.65, 3) * (high - low)
    knee[0] = 0.0
    whole, halves = generator.uniform(-_STRETCH, _STRETCH, (2, 3))
    halves[0] = 0.0
    factors = np.exp(np.stack((whole - halves / 2, whole + halves / 2)))
    return tuple(_stretched(surface, knee, factors) for surface in surfaces)


def recoloured(surfaces: Sequence[Surface], name: str, recolouring: int) -> tuple[Surface, ...]:
    """The object in other colours; the mesh as it is for recolouring 0.

    Similar colours belong to one part and change together; what is black or grey mostly stays (tyres, glass).
    """
    if recolouring == 0:
        return tuple(surfaces)
    recolour = _recolouring(surfaces, _generator(name, 2, recolouring))
    return tuple(_repainted(surface, recolour) for surface in surfaces)


def _stretched(surface: Surface, knee: Float[np.ndarray, "3"], factors: Float[np.ndarray, "2 3"]) -> Surface:
    """Stretched along each axis by the first factors below the knee and by the second above it."""
    away = surface.vertices - knee
    factor = np.where(away < 0, factors[0], factors[1])
    return replace(surface, vertices=knee + away * factor, normals=surface.normals / factor)


def _recolouring(surfaces: Sequence[Surface], generator: np.random.Generator) -> Recolouring:
    """New colours for the groups of colour that an object shows, the largest one among them."""
    seen = _seen_colours(surfaces, generator)
    count = min(_COLOURS, len(np.unique(np.round(seen, 2), axis=0)))
    centres, group = kmeans2(seen, count, minit="++", seed=generator)
    sizes = np.bincount(group, minlength=count)
    targets = centres.copy()
    for index in range(count):
        bright, dull = centres[index].max(), centres[index].min()
        vivid = bright > 0.22 and bright - dull > 0.25 * bright
        if index == sizes.argmax() or generator.random() < (0.6 if vivid else 0.2):
            targets[index] = any_colour(generator)

    def recolour(colours: Float[np.ndarray, "*colours 3"]) -> Float[np.ndarray, "*colours 3"]:
        nearest = np.stack([((colours - centre) ** 2).sum(-1) for centre in centres]).argmin(0)
        return np.clip(colours + (targets - centres)[nearest], 0.05, 0.95)

    return recolour


def _seen_colours(surfaces: Sequence[Surface], generator: np.random.Generator) -> Float[np.ndarray, "4096 3"]:
    """Colours of points sampled evenly over the surfaces."""
    found, areas = [], []
    for surface in surfaces:
        a, b, c = surface.vertices[surface.faces.T]
        areas.append(np.linalg.norm(np.cross(b - a, c - a), axis=-1))
        colours = surface.colours[surface.faces].mean(1)
        if surface.texture is not None and surface.uvs is not None:
            height, width = surface.texture.shape[:2]
            across, down = (surface.uvs[surface.faces].mean(1) % 1.0).T
            texels = surface.texture[(down * (height - 1)).astype(int), (across * (width - 1)).astype(int), :3]
            colours = colours * (texels / 255.0)
        found.append(colours)
    share = np.concatenate(areas) + 1e-12
    sampled = generator.choice(len(share), 4096, p=share / share.sum())
    return np.concatenate(found)[sampled]


def _repainted(surface: Surface, recolour: Recolouring) -> Surface:
    """A surface in its new colours; the factor of a textured one moves into its texture."""
    if surface.texture is None:
        return replace(surface, colours=recolour(surface.colours))
    image = Image.fromarray(surface.texture)
    image.thumbnail((_TEXELS, _TEXELS))
    texels = np.asarray(image)
    fresh = recolour(texels[..., :3] / 255.0 * surface.colours[0])
    texture = np.concatenate((np.round(fresh * 255).astype(np.uint8), texels[..., 3:]), -1)
    return replace(surface, colours=np.ones_like(surface.colours), texture=texture)


def _generator(name: str, kind: int, index: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), kind, index])
