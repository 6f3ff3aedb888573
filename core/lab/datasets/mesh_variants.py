"""Variants of a mesh with other proportions and colours, each a separate identity."""

import colorsys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.cluster.vq import kmeans2

from core.lab.datasets.rasteriser import Surface

_COLOURS = 6  # largest number of colour groups, taken as the parts of a mesh
_STRETCH = 0.16  # largest logarithm of the stretch along an axis, and of the ratio between its two halves
_TEXELS = 1024  # px; larger textures are shrunk to this before recolouring

Recolouring = Callable[[Float[np.ndarray, "*colours 3"]], Float[np.ndarray, "*colours 3"]]


def pairs(variants: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs (shape, recolouring) to render of a mesh with ``variants`` additional shapes.

    With n shapes there are n - 1 recolourings. Each shape has one or two of them and shares one with the next shape:
    about half of the table. (0, 0) is the unchanged mesh.
    """
    colourings = max(1, variants)
    filled = [(shape, colours) for shape in range(colourings) for colours in (shape, shape + 1) if colours < colourings]
    return (*filled, (variants, 0)) if variants else ((0, 0),)


def deformed(surfaces: Sequence[Surface], name: str, shape: int) -> tuple[Surface, ...]:
    """Deform the proportions of an object; shape 0 is the unchanged mesh.

    Stretches length, width and height; along length and height the parts below and above a random position differ. The
    object stays symmetric.
    """
    if shape == 0:
        return tuple(surfaces)
    generator = _generator(name, 1, shape)
    used = np.vstack([surface.vertices for surface in surfaces])
    low = used.min(0)
    high = used.max(0)
    knee = low + generator.uniform(0.35, 0.65, 3) * (high - low)
    knee[0] = 0.0
    stretch, halves = generator.uniform(-_STRETCH, _STRETCH, (2, 3))
    halves[0] = 0.0
    factors = np.exp(np.stack((stretch - halves / 2, stretch + halves / 2)))
    deformed = []
    for surface in surfaces:
        away = surface.vertices - knee
        factor = np.where(away < 0, *factors)  # of the halves before and behind the knee
        deformed.append(replace(surface, vertices=knee + away * factor, normals=surface.normals / factor))
    return tuple(deformed)


def recoloured(surfaces: Sequence[Surface], name: str, recolouring: int) -> tuple[Surface, ...]:
    """Recolour an object; recolouring 0 is the unchanged mesh.

    Similar colours form a part and change together; black and grey (tyres, glass) mostly stay.
    """
    if recolouring == 0:
        return tuple(surfaces)
    recolour = _recolouring(surfaces, _generator(name, 2, recolouring))
    return tuple(_repainted(surface, recolour) for surface in surfaces)


def _recolouring(surfaces: Sequence[Surface], generator: np.random.Generator) -> Recolouring:
    """Choose new colours for groups of an object's colours, always including the largest group."""
    samples = _sample_colours(surfaces, generator)
    count = min(_COLOURS, len(np.unique(np.round(samples, 2), axis=0)))
    centres, group = kmeans2(samples, count, minit="++", seed=generator)
    sizes = np.bincount(group, minlength=count)
    targets = centres.copy()
    for index in range(count):
        bright = centres[index].max()
        dull = centres[index].min()
        vivid = bright > 0.22 and bright - dull > 0.25 * bright
        if index == sizes.argmax() or generator.random() < (0.6 if vivid else 0.2):
            targets[index] = _any_colour(generator)

    def recolour(colours: Float[np.ndarray, "*colours 3"]) -> Float[np.ndarray, "*colours 3"]:
        nearest = np.stack([((colours - centre) ** 2).sum(-1) for centre in centres]).argmin(0)
        return np.clip(colours + (targets - centres)[nearest], 0.05, 0.95)

    return recolour


def _sample_colours(surfaces: Sequence[Surface], generator: np.random.Generator) -> Float[np.ndarray, "4096 3"]:
    """Sample colours evenly over the surfaces."""
    face_colours = []
    areas = []
    for surface in surfaces:
        a, b, c = surface.vertices[surface.faces.T]
        areas.append(np.linalg.norm(np.cross(b - a, c - a), axis=-1))
        colours = surface.colours[surface.faces].mean(1)
        if surface.texture is not None and surface.uvs is not None:
            height, width = surface.texture.shape[:2]
            u, v = (surface.uvs[surface.faces].mean(1) % 1.0).T
            texels = surface.texture[(v * (height - 1)).astype(int), (u * (width - 1)).astype(int), :3]
            colours = colours * (texels / 255.0)
        face_colours.append(colours)
    weights = np.concatenate(areas) + 1e-12
    sampled = generator.choice(len(weights), 4096, p=weights / weights.sum())
    return np.concatenate(face_colours)[sampled]


def _repainted(surface: Surface, recolour: Recolouring) -> Surface:
    """Recolour a surface; the factor of a textured one moves into its texture."""
    if surface.texture is None:
        return replace(surface, colours=recolour(surface.colours))
    image = Image.fromarray(surface.texture)
    image.thumbnail((_TEXELS, _TEXELS))
    texels = np.asarray(image)
    fresh = recolour(texels[..., :3] / 255.0 * surface.colours[0])
    texture = np.concatenate((np.round(fresh * 255).astype(np.uint8), texels[..., 3:]), -1)
    return replace(surface, colours=np.ones_like(surface.colours), texture=texture)


def _any_colour(generator: np.random.Generator) -> Float[np.ndarray, "3"]:
    """Sample a household colour: grey, pastel, deep or vivid."""
    kind = generator.integers(4)
    saturation = generator.uniform((0.0, 0.15, 0.45, 0.65), (0.08, 0.35, 0.8, 0.95))[kind]
    value = generator.uniform((0.12, 0.7, 0.2, 0.6), (0.95, 0.95, 0.5, 0.95))[kind]
    return np.array(colorsys.hsv_to_rgb(generator.random(), saturation, value))


def _generator(name: str, kind: int, index: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(name.encode()), kind, index])
