"""The authors' network and renderer in plain numpy, after their paper and conventions; nothing of ``core`` is used.

Their conventions: the positional encoding has no factor pi, rgb has no sigmoid, density is a softplus, rays pass
through pixel corners, samples stand at both ends of [near, far] and the last interval is 1e10 long. Where density is
below about 1e-10 light gets past even that one, and falls on white.
``python -m tests.core.models.authors_reference`` writes the golden files beside it: a small random network as their
trainer saves one, and its renders.
"""

import json
import math
from pathlib import Path

import numpy as np
import torch

GOLDEN = Path(__file__).parent / "authors"
NEAR, FAR = 0.8, 1.8
SAMPLES = 48
SIDE, FOCAL = 24, 24.6
_SIZES = {"shape_blocks": 2, "texture_blocks": 1, "W": 16, "num_xyz_freq": 4, "num_dir_freq": 2, "latent_dim": 6}
_OBJECTS = 4

Weights = dict[str, np.ndarray]


def read_weights(checkpoint: Path) -> tuple[Weights, np.ndarray, np.ndarray]:
    """The network's tensors by their names, the shape codes and the texture codes, in float64."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network = {name: tensor.double().numpy() for name, tensor in state["model_params"].items()}
    return network, *(state[f"{kind}_code_params"]["weight"].double().numpy() for kind in ("shape", "texture"))


def evaluate(
    network: Weights, points: np.ndarray, directions: np.ndarray, shape: np.ndarray, texture: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Density (n,) and rgb (n, 3) at points seen along directions, both (n, 3)."""
    y = _relu(_linear(network, "encoding_xyz.0", _encode(network, "encoding_xyz.0", 0, points)))
    for block in range(1, 1 + _count(network, "shape_layer")):
        y = y + _relu(_linear(network, f"shape_latent_layer_{block}.0", shape))
        y = _relu(_linear(network, f"shape_layer_{block}.0", y))
    y = _linear(network, "encoding_shape", y)
    density = np.logaddexp(0.0, _linear(network, "sigma.0", y)[:, 0])
    encoded = _encode(network, "encoding_viewdir.0", y.shape[1], directions)
    y = _relu(_linear(network, "encoding_viewdir.0", np.concatenate((y, encoded), 1)))
    for block in range(1, 1 + _count(network, "texture_layer")):
        y = y + _relu(_linear(network, f"texture_latent_layer_{block}.0", texture))
        y = _relu(_linear(network, f"texture_layer_{block}.0", y))
    return density, _linear(network, "rgb.2", _relu(_linear(network, "rgb.0", y)))


def render(
    network: Weights, codes: tuple[np.ndarray, np.ndarray], pose: np.ndarray, focal: float, side: int, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """An image (side, side, 3) and its depths (side, side) from an SRN pose: camera-to-world, looking along +z."""
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    towards = np.stack(((column - side / 2) / focal, (row - side / 2) / focal, np.ones((side, side))), -1)
    directions = towards.reshape(-1, 3) @ pose[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    depths = np.linspace(NEAR, FAR, samples)
    colour = np.zeros((side * side, 3))
    depth = np.zeros(side * side)
    light = np.ones(side * side)
    for distance, length in zip(depths, [*np.diff(depths), 1e10], strict=True):
        density, rgb = evaluate(network, pose[:3, 3] + distance * directions, directions, *codes)
        weight = light * (1 - np.exp(-density * length))
        colour += weight[:, None] * rgb
        depth += weight * distance
        light = light * np.exp(-density * length)
    colour += light[:, None]
    return colour.reshape(side, side, 3), depth.reshape(side, side)


def _encode(network: Weights, layer: str, more: int, values: np.ndarray) -> np.ndarray:
    """Return the values, then all sines, then all cosines, with as many frequencies as the layer takes."""
    frequencies = (network[f"{layer}.weight"].shape[1] - more - 3) // 6
    angles = np.concatenate([2.0**octave * values for octave in range(frequencies)], 1)
    return np.concatenate((values, np.sin(angles), np.cos(angles)), 1)


def _linear(network: Weights, layer: str, values: np.ndarray) -> np.ndarray:
    return values @ network[f"{layer}.weight"].T + network[f"{layer}.bias"]


def _relu(values: np.ndarray) -> np.ndarray:
    return np.maximum(values, 0.0)


def _count(network: Weights, block: str) -> int:
    return sum(name.startswith(block) and name.endswith("weight") for name in network)


def srn_pose(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """Camera-to-world with OpenCV axes (x right, y down, z forward), looking at the origin, world z up."""
    horizontal = np.array([math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth)])
    position = distance * np.array([*horizontal, math.sin(elevation)])
    forward = -position / distance
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack((right, np.cross(forward, right), forward, position), 1)
    return pose


def write_golden(folder: Path) -> None:
    """``models.pth``, ``hpam.json`` and ``expected.npz``."""
    folder.mkdir(exist_ok=True)
    settings = {"net_hyperparams": _SIZES, "data": {"cat": "srn_cars"}, "near": NEAR, "far": FAR, "N_samples": SAMPLES}
    (folder / "hpam.json").write_text(json.dumps(settings, indent=2) + "\n")
    torch.save(_random_checkpoint(np.random.default_rng(0)), folder / "models.pth")
    network, shapes, textures = read_weights(folder / "models.pth")
    expected = {}
    for index, (shape, texture, azimuth, elevation) in enumerate([(0, 1, 0.3, 0.2), (2, 2, 2.5, 0.9), (3, 0, 4.4, 0)]):
        pose = srn_pose(azimuth, elevation, (NEAR + FAR) / 2)
        colour, depth = render(network, (shapes[shape], textures[texture]), pose, FOCAL, SIDE, SAMPLES)
        arrays = {"pose": pose, "codes": np.array([shape, texture]), "rgb": colour, "depth": depth}
        expected |= {f"{name}_{index}": array for name, array in arrays.items()}
    stored = {name: value if value.dtype.kind == "i" else value.astype(np.float32) for name, value in expected.items()}
    np.savez_compressed(
        folder / "expected.npz", **stored | {name: expected[name] for name in expected if "pose" in name}
    )


def _random_checkpoint(generator: np.random.Generator) -> dict:
    """Weights large enough that density runs from nothing to solid, and rgb leaves [0, 1]."""
    width = _SIZES["W"]
    latent = _SIZES["latent_dim"]
    sizes = {
        "encoding_xyz.0": (width, 3 + 6 * _SIZES["num_xyz_freq"]),
        "shape_latent_layer_1.0": (width, latent),
        "shape_layer_1.0": (width, width),
        "shape_latent_layer_2.0": (width, latent),
        "shape_layer_2.0": (width, width),
        "encoding_shape": (width, width),
        "sigma.0": (1, width),
        "encoding_viewdir.0": (width, width + 3 + 6 * _SIZES["num_dir_freq"]),
        "texture_latent_layer_1.0": (width, latent),
        "texture_layer_1.0": (width, width),
        "rgb.0": (width // 2, width),
        "rgb.2": (3, width // 2),
    }
    network = {}
    for layer, (outputs, inputs) in sizes.items():
        network[f"{layer}.weight"] = _normal(generator, (outputs, inputs), math.sqrt(2 / inputs))
        network[f"{layer}.bias"] = _normal(generator, (outputs,), 0.1)
    codes = [{"weight": _normal(generator, (_OBJECTS, latent), 0.7)} for _ in range(2)]
    _spread(network, generator, *(table["weight"].double().numpy() for table in codes))
    names = ("model_params", "shape_code_params", "texture_code_params")
    return dict(zip(names, (network, *codes), strict=True)) | {"niter": 0, "nepoch": 0}


def _spread(network: dict[str, torch.Tensor], generator: np.random.Generator, shapes: np.ndarray, textures: np.ndarray):
    """Scale the last layers: over the box, density's logit is -15 +- 20 and rgb 0.5 +- 0.5 in every channel."""
    points = generator.uniform(-0.5, 0.5, (2000, 3))
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    codes = (generator.permutation(np.resize(rows, (2000, rows.shape[1]))) for rows in (shapes, textures))
    density, rgb = evaluate(
        {name: tensor.double().numpy() for name, tensor in network.items()}, points, directions, *codes
    )
    logits = np.log(np.expm1(density))
    for layer, outputs, middle, deviation in (("sigma.0", logits[:, None], -15.0, 20.0), ("rgb.2", rgb, 0.5, 0.5)):
        scale = torch.from_numpy(deviation / outputs.std(0)).float()
        network[f"{layer}.weight"] *= scale[:, None]
        network[f"{layer}.bias"] = (
            network[f"{layer}.bias"] - torch.from_numpy(outputs.mean(0)).float()
        ) * scale + middle


def _normal(generator: np.random.Generator, shape: tuple[int, ...], deviation: float) -> torch.Tensor:
    return torch.from_numpy(generator.normal(0.0, deviation, shape)).float()


if __name__ == "__main__":
    write_golden(GOLDEN)
