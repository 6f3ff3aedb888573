from dataclasses import replace

import torch

from core.models.code_map import CodeMap
from core.models.codes import CodeBook, Codes, Entry
from core.models.model import Model

SHAPE, TEXTURE = 5, 3


def book(objects: int, seed: int = 0, first: int = 0) -> CodeBook:
    generator = torch.Generator().manual_seed(seed)
    shapes, textures = (torch.randn(objects, latent, generator=generator) for latent in (SHAPE, TEXTURE))
    return CodeBook(shapes, textures, tuple(Entry(f"object {first + i}", i, i) for i in range(objects)))


def test_codes_that_were_mapped_affinely_are_mapped_alike() -> None:
    former = book(200)
    turn, shift = torch.linalg.qr(torch.randn(SHAPE, SHAPE)).Q, torch.randn(SHAPE)
    now = replace(former, shapes=former.shapes @ turn + shift, textures=2 * former.textures)
    unseen = Codes(torch.randn(4, SHAPE), torch.randn(4, TEXTURE))
    mapped = CodeMap.fitted(former, now)(unseen)
    torch.testing.assert_close(mapped.shape, unseen.shape @ turn + shift, atol=2e-3, rtol=0)
    torch.testing.assert_close(mapped.texture, 2 * unseen.texture, atol=2e-3, rtol=0)


def test_only_objects_of_both_tell_of_the_change_and_without_any_nothing_changes() -> None:
    former = book(4)
    codes = Codes(torch.randn(SHAPE), torch.randn(TEXTURE))
    mapped = CodeMap.fitted(former, book(4, seed=1, first=4))(codes)
    torch.testing.assert_close((mapped.shape, mapped.texture), (codes.shape, codes.texture))
    moved = book(200)
    shifted = replace(book(300, first=0), shapes=torch.cat([moved.shapes + 1, torch.randn(100, SHAPE)]))
    shifted = replace(shifted, textures=torch.cat([moved.textures, torch.randn(100, TEXTURE)]))
    assert torch.allclose(CodeMap.fitted(moved, shifted)(codes).shape, codes.shape + 1, atol=2e-3)


def test_a_model_file_keeps_the_map(model: Model, tmp_path) -> None:
    other = replace(model.codes, shapes=model.codes.shapes + 0.5)
    extended = replace(model, extends=("former",), code_map=CodeMap.fitted(model.codes, other))
    extended.save(tmp_path / "m.safetensors")
    again, codes = Model.load(tmp_path / "m.safetensors"), model.codes[2]
    assert again.fingerprint == model.fingerprint
    assert again.codes_of(codes, model.fingerprint) is codes
    assert again.codes_of(codes, "former") == extended.code_map(codes)
    assert (again.codes_of(codes, "former").shape - codes.shape).mean() > 0.1
