"""8-bit coding of maps, PNG bytes, file names."""

import numpy as np
import pytest
import torch
from PIL import Image
from tests.export.exporting import asset, known_maps

from paintit.errors import OutputError
from paintit.export.image import encode_maps, png_bytes, quantize, safe_name, unique_names, write_maps
from paintit.texture.maps import TextureMaps


def test_rounding_is_half_up() -> None:
    values = torch.tensor([0.0, 0.5 / 255 - 1e-6, 0.5 / 255 + 1e-6, 127.5 / 255 + 1e-6, 1.0, -1.0, 2.0])
    assert quantize(values).tolist() == [0, 0, 1, 128, 255, 0, 255]


def test_known_values() -> None:
    """Linear 0.2 is sRGB 0.48453; roughness and metalness are stored as they are; a flat normal is (128, 128, 255)."""
    one = torch.ones(1, 1, 1, 1)
    maps = TextureMaps(
        0.2 * torch.ones(1, 1, 1, 3), 0.25 * one, 0.75 * one, torch.tensor([0.0, 0, 1]).expand(1, 1, 1, 3)
    )
    (layer,) = encode_maps(maps)
    assert layer.base_color[0, 0].tolist() == [124, 124, 124]
    assert layer.orm[0, 0].tolist() == [255, 64, 191]
    assert layer.normal[0, 0].tolist() == [128, 128, 255]


def test_not_finite_is_refused() -> None:
    maps = known_maps(asset("spot/spot.obj"), 4)
    maps.roughness[0, 1, 2] = float("nan")
    with pytest.raises(OutputError) as caught:
        encode_maps(maps)
    assert caught.value.code == "output.not_finite"


def test_png_is_reproducible_and_exact() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (33, 17, 4), np.uint8)
    assert png_bytes(pixels) == png_bytes(pixels.copy())
    import io

    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(pixels)))), pixels)


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("wood", "wood"),
        ("a/b\\c:d", "a_b_c_d"),
        ("../../etc", "etc"),
        ("", "material"),
        ("...", "material"),
        ("con", "con_"),
        ("Glas 1.001", "Glas_1.001"),
        ("x" * 99, "x" * 64),
        ("木", "material"),
    ],
)
def test_safe_name(name: str, safe: str) -> None:
    assert safe_name(name) == safe


def test_names_differ_even_without_case() -> None:
    assert unique_names(["Wood", "wood", "a/b", "a b"]) == ["Wood", "wood_2", "a_b", "a_b_2"]


def test_write_maps(tmp_path) -> None:
    mesh = asset("teapot/teapot.obj")
    maps = known_maps(mesh, 8)
    paths = write_maps(tmp_path / "textures", mesh, maps)
    assert sorted(p.name for p in paths) == sorted(
        f"{kind}_{name}.png"
        for kind in ("base_color", "orm", "normal")
        for name in ("beige_with_flowers", "beige_teapot")
    )
    read = np.asarray(Image.open(tmp_path / "textures" / "orm_beige_teapot.png"))
    assert np.array_equal(read, encode_maps(maps)[1].orm)


def test_layers_must_match(tmp_path) -> None:
    with pytest.raises(OutputError) as caught:
        write_maps(tmp_path, asset("teapot/teapot.obj"), known_maps(asset("spot/spot.obj"), 8))
    assert caught.value.code == "output.layers"
    assert list(tmp_path.iterdir()) == []
