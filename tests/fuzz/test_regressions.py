"""Inputs that once made a reader fail: each must be read, or refused in one line."""

from __future__ import annotations

import platform
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from tests.fuzz.fuzz_readers import FORMATS, check
from tests.fuzz.mutators import pack_glb, unpack_glb
from tests.fuzz.seeds import seeds

from paintit.mesh.read import read_as_it_is, read_mesh

REGRESSIONS = Path(__file__).parent / "regressions"


@pytest.mark.parametrize("path", sorted(REGRESSIONS.iterdir()), ids=lambda path: path.name)
def test_nothing_but_a_mesh_or_a_refusal(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(path, unwrap=False)


def test_what_no_corner_uses_may_be_anything() -> None:
    check(REGRESSIONS / "unused_texture_coordinate_of_1e999.obj", unwrap=True)


@pytest.mark.parametrize("name", ["triangle_of_1e-160.glb", "sliver_over_100000_repeats.glb"])
def test_hostile_texture_coordinates_cost_next_to_nothing(name: str) -> None:
    tracemalloc.start()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read_mesh(REGRESSIONS / name)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()


glibc = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc can fill new memory")
PANICS = sorted(REGRESSIONS.glob("uvunwrap_*.obj"))


@glibc
@pytest.mark.parametrize("path", PANICS, ids=lambda path: path.name)
def test_an_unwrap_does_not_depend_on_what_memory_held_before(path: Path) -> None:
    meshes = [read_mesh(path) for _ in range(5)]
    assert all("with uvunwrap" in mesh.report.notes[-1] for mesh in meshes)
    assert all(np.array_equal(mesh.corner_uvs, meshes[0].corner_uvs) for mesh in meshes)


@glibc
@pytest.mark.parametrize("path", PANICS, ids=lambda path: path.name)
def test_a_panic_of_the_first_unwrapper_leads_to_the_second(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("paintit.mesh.unwrap._ZEROS", 0x55)
    mesh = read_mesh(path)
    assert mesh.report.uv_origin == "unwrapped"
    assert "with xatlas" in mesh.report.notes[-1]


@pytest.mark.parametrize("kind", FORMATS)
def test_every_seed_is_a_mesh(kind: str, tmp_path: Path) -> None:
    """A seed that is refused would teach the fuzzer only refusals."""
    for data in seeds(kind):
        path = tmp_path / f"seed.{kind}"
        path.write_bytes(data)
        assert len(read_as_it_is(path).faces)


def test_a_glb_is_unpacked_and_packed(tmp_path: Path) -> None:
    data = next(iter(seeds("glb")))
    assert pack_glb(*unpack_glb(data)) == data
