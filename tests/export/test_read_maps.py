"""Maps written and read back: to a rounding step in 8 bits, factors applied, UVs followed."""

import numpy as np
import pytest
import torch
from tests.export.exporting import add_image, asset, grid_document, known_maps, save

from paintit.color import encode_srgb
from paintit.errors import MeshError
from paintit.export.gltf import write_gltf
from paintit.export.image import write_maps
from paintit.export.read_maps import read_emission, read_maps, read_maps_folder, read_occlusion
from paintit.mesh.read import read_mesh
from paintit.texture.maps import TextureMaps


def assert_close(read: TextureMaps, wrote: TextureMaps) -> None:
    assert read.size == wrote.size
    assert (encode_srgb(read.base_color) - encode_srgb(wrote.base_color)).abs().max() < 0.51 / 255
    assert (read.roughness - wrote.roughness).abs().max() < 0.51 / 255
    assert (read.metallic - wrote.metallic).abs().max() < 0.51 / 255
    assert (read.normal - wrote.normal).abs().max() < 2.1 / 255


@pytest.mark.parametrize("name", ["teapot/teapot.obj", "flight_helmet.glb", "rigged_figure.glb"])
def test_round_trip_through_glb(name: str, tmp_path) -> None:
    mesh = asset(name)
    maps = known_maps(mesh)
    write_gltf(tmp_path / "out.glb", mesh, maps, {})
    assert_close(read_maps(read_mesh(tmp_path / "out.glb")), maps)


def test_round_trip_through_a_folder(tmp_path) -> None:
    mesh = asset("teapot/teapot.obj")
    maps = known_maps(mesh)
    write_maps(tmp_path, mesh, maps)
    assert_close(read_maps_folder(tmp_path, mesh), maps)
    (tmp_path / "orm_beige_teapot.png").unlink()
    with pytest.raises(MeshError) as caught:
        read_maps_folder(tmp_path, mesh)
    assert caught.value.code == "maps.missing"
    assert "orm_beige_teapot.png" in str(caught.value)


def test_factors_without_textures() -> None:
    maps = read_maps(asset("rigged_figure.glb"))
    np.testing.assert_allclose(maps.base_color.numpy(), 0.8, atol=1e-6)
    assert maps.metallic.max() == 0
    assert maps.roughness.min() == 1
    assert torch.equal(maps.normal[..., 2], torch.ones_like(maps.normal[..., 2]))


def test_factors_times_textures(tmp_path) -> None:
    assembly = grid_document([{"name": "m"}])
    coded = add_image(assembly, np.full((8, 8, 3), 188, np.uint8))
    orm = add_image(assembly, np.full((4, 4, 3), (9, 128, 64), np.uint8))
    assembly.json["materials"][0]["pbrMetallicRoughness"] = {
        "baseColorTexture": {"index": coded},
        "baseColorFactor": [1, 0.5, 0, 1],
        "metallicRoughnessTexture": {"index": orm},
        "roughnessFactor": 0.5,
    }
    maps = read_maps(read_mesh(save(assembly, tmp_path / "in.glb")))
    assert maps.size == (8, 8)
    np.testing.assert_allclose(maps.base_color[0, 3, 3].numpy(), [0.5029, 0.25145, 0], atol=1e-4)
    np.testing.assert_allclose(maps.roughness.numpy(), 0.5 * 128 / 255, atol=1e-6)
    np.testing.assert_allclose(maps.metallic.numpy(), 64 / 255, atol=1e-6)


def test_emission(tmp_path) -> None:
    """Factor times decoded texture times strength; where nothing emits there is nothing to add."""
    assembly = grid_document([{"name": "m", "emissiveFactor": [1, 0.5, 0]}])
    assembly.json["materials"][0]["emissiveTexture"] = {"index": add_image(assembly, np.full((8, 8, 3), 188, np.uint8))}
    assembly.json["materials"][0]["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}
    emission = read_emission(read_mesh(save(assembly, tmp_path / "in.glb")), 16)
    assert emission is not None
    assert emission.shape == (1, 16, 16, 3)
    np.testing.assert_allclose(emission[0, 3, 3].numpy(), [2.0, 1.0, 0.0], rtol=1e-2)
    assert read_emission(asset("rigged_figure.glb"), 16) is None
    assert read_emission(asset("teapot/teapot.obj"), 16) is None


def test_occlusion(tmp_path) -> None:
    """The red channel, at the texture's strength; where nothing is occluded there is nothing to dim."""
    assembly = grid_document([{"name": "m"}])
    texture = add_image(assembly, np.full((8, 8, 3), (102, 255, 0), np.uint8))
    assembly.json["materials"][0]["occlusionTexture"] = {"index": texture, "strength": 0.5}
    occlusion = read_occlusion(read_mesh(save(assembly, tmp_path / "in.glb")), 16)
    assert occlusion is not None
    assert occlusion.shape == (1, 16, 16, 1)
    np.testing.assert_allclose(occlusion.numpy(), 0.7, atol=1e-6)
    assert read_occlusion(asset("rigged_figure.glb"), 16) is None
    assert read_occlusion(asset("teapot/teapot.obj"), 16) is None


def test_textures_follow_an_unwrap(tmp_path) -> None:
    """After an unwrap the same place on the surface reads the same roughness: here it is the file's u."""
    ramp = np.repeat(np.linspace(0, 255, 64).round().astype(np.uint8)[None], 64, 0)
    assembly = grid_document([{"name": "m"}])
    info = {"index": add_image(assembly, np.stack([ramp] * 3, -1))}
    assembly.json["materials"][0]["pbrMetallicRoughness"] = {"metallicRoughnessTexture": info}
    source = save(assembly, tmp_path / "in.glb")
    kept, moved = read_mesh(source, "never"), read_mesh(source, "always")
    maps = read_maps(moved, 128)
    u = kept.corner_uvs.mean(1)[:, 0]
    x, y = (moved.corner_uvs.mean(1) * 128).astype(int).T
    np.testing.assert_allclose(maps.roughness[0, y, x, 0].numpy(), u, atol=0.03)


def test_other_formats_have_none() -> None:
    with pytest.raises(MeshError) as caught:
        read_maps(asset("spot/spot.obj"))
    assert caught.value.code == "maps.none"
