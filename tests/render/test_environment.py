"""Reading environment maps: values, orientation, exposure, and one-line errors."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from paintit.errors import LightError
from paintit.render.environment import (
    decode_rgbe,
    direction_to_uv,
    from_radiance,
    load_environment,
    mean_radiance,
    texel_directions,
)

SHIPPED = ["mud_road_puresky_512", "st_fagans_interior_512", "studio_small_03_512", "venice_sunset_512"]


def encode(values: np.ndarray) -> np.ndarray:
    """(h, w, 3) -> (h, w, 4) uint8 RGBE."""
    brightest = values.max(-1)
    mantissa, exponent = np.frexp(brightest)
    scale = np.where(brightest > 0, mantissa * 256 / np.maximum(brightest, 1e-30), 0)
    out = np.zeros((*values.shape[:2], 4), np.uint8)
    out[..., :3] = values * scale[..., None]
    out[..., 3] = np.where(brightest > 0, exponent + 128, 0)
    return out


def hdr(pixels: np.ndarray, *, rle: bool, header: str = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n") -> bytes:
    """A whole file of (h, w, 4) RGBE bytes; runs of 3 and more are coded as runs where ``rle``."""
    height, width, _ = pixels.shape
    data = bytearray(f"{header}\n-Y {height} +X {width}\n".encode())
    for row in pixels:
        if not rle:
            data += row.tobytes()
            continue
        data += bytes((2, 2, width >> 8, width & 255))
        for channel in row.T:
            data += _runs(channel.tobytes())
    return bytes(data)


def _runs(line: bytes) -> bytes:
    out, at = bytearray(), 0
    while at < len(line):
        end = at + 1
        while end < len(line) and line[end] == line[at] and end - at < 127:
            end += 1
        if end - at >= 3:
            out += bytes((128 + end - at, line[at]))
        else:
            end = min(at + 2, len(line))
            out += bytes((end - at,)) + line[at:end]
        at = end
    return bytes(out)


@pytest.fixture
def values() -> np.ndarray:
    generator = np.random.default_rng(0)
    values = generator.uniform(0.1, 1, (16, 32, 3)) * np.exp(generator.uniform(-4, 6, (16, 32, 1)))
    values[2, 5:20] = 0.25
    values[3] = 0
    return values.astype(np.float32)


@pytest.mark.parametrize("rle", [False, True])
def test_rgbe_values(values: np.ndarray, rle: bool) -> None:
    decoded = decode_rgbe(hdr(encode(values), rle=rle), "x")
    # One step of the shared exponent is 1/128 of the brightest channel.
    assert (np.abs(decoded - values) <= values.max(-1, keepdims=True) / 128).all()
    assert (decoded[3] == 0).all()
    assert (decoded[2, 5:20] == 0.25).all()


def test_rgbe_exposure_lines_are_undone(values: np.ndarray) -> None:
    plain = decode_rgbe(hdr(encode(values), rle=True), "x")
    header = "#?RADIANCE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\nEXPOSURE= 4.0\n"
    np.testing.assert_allclose(decode_rgbe(hdr(encode(values), rle=True, header=header), "x"), plain / 8)


@pytest.mark.judge
@pytest.mark.parametrize("name", SHIPPED)
def test_rgbe_as_mitsuba_reads_it(assets: Path, name: str) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    path = assets / "envmaps" / f"{name}.hdr"
    theirs = np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
    np.testing.assert_array_equal(load_environment(path).radiance.numpy(), theirs)


@pytest.mark.parametrize("name", [*SHIPPED, "default"])
def test_shipped_environments(assets: Path, name: str) -> None:
    path = name if name == "default" else assets / "envmaps" / f"{name}.hdr"
    environment = load_environment(path, exposure=0.7)
    height, width, channels = environment.radiance.shape
    assert (width, channels) == (2 * height, 3)
    exposed = mean_radiance(environment.radiance) * environment.exposure_factor
    assert float(exposed @ torch.tensor([0.2126, 0.7152, 0.0722], dtype=torch.float64)) == pytest.approx(0.7)
    assert environment.name == name
    assert len(environment.sha256) == 64
    sky, ground = environment.radiance[: height // 2].mean(), environment.radiance[height // 2 :].mean()
    if name in ("default", "mud_road_puresky_512", "venice_sunset_512"):
        assert sky > ground


def test_exposure_zero_keeps_the_file() -> None:
    assert load_environment("default", exposure=0).exposure_factor == 1.0


def test_exr(tmp_path: Path, values: np.ndarray) -> None:
    import OpenEXR

    values[0, 0] = -1e-6
    path = tmp_path / "light.exr"
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"RGB": values}).write(str(path))
    np.testing.assert_array_equal(load_environment(path).radiance.numpy(), np.maximum(values, 0))
    grey = tmp_path / "grey.exr"
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, {"Y": np.abs(values[..., 0])}).write(str(grey))
    assert load_environment(grey).radiance.shape == (16, 32, 3)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -5.0])
def test_exr_that_is_no_radiance(tmp_path: Path, values: np.ndarray, bad: float) -> None:
    import OpenEXR

    values[4, 4, 1] = bad * (values.max() if bad < 0 else 1)
    path = tmp_path / "light.exr"
    OpenEXR.File({}, {"RGB": values}).write(str(path))
    with pytest.raises(LightError) as caught:
        load_environment(path)
    assert caught.value.code == ("light.negative" if bad < 0 else "light.not_finite")


def test_orientation() -> None:
    axis = torch.tensor([[0.0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    u, v = direction_to_uv(axis).unbind(-1)
    torch.testing.assert_close(u[:3], torch.tensor([0.5, 0.25, 0.75]))
    torch.testing.assert_close(v, torch.tensor([0.5, 0.5, 0.5, 0.0, 1.0]), atol=1e-6, rtol=0)


def test_texel_directions_are_the_inverse() -> None:
    direction, solid_angle = texel_directions(16, 32, torch.float64)
    uv = direction_to_uv(direction)
    torch.testing.assert_close(uv[..., 0] * 32, (torch.arange(32).double() + 0.5).expand(16, 32))
    torch.testing.assert_close(uv[..., 1] * 16, (torch.arange(16).double() + 0.5)[:, None].expand(16, 32))
    assert float(solid_angle.sum()) == pytest.approx(4 * math.pi)


def test_gradient_at_the_poles_is_finite() -> None:
    pole = torch.tensor([[0.0, 1, 0], [0, -1, 0]], requires_grad=True)
    direction_to_uv(pole).sum().backward()
    assert pole.grad is not None
    assert pole.grad.isfinite().all()


def _file(tmp_path: Path, data: bytes, name: str = "bad.hdr") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


def _code(path: Path | str) -> str:
    with pytest.raises(LightError) as caught:
        load_environment(path)
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    return caught.value.code


@pytest.mark.parametrize("rle", [False, True])
@pytest.mark.parametrize("share", [0.99, 0.5, 0.2])
def test_truncated(tmp_path: Path, values: np.ndarray, rle: bool, share: float) -> None:
    data = hdr(encode(values), rle=rle)
    assert _code(_file(tmp_path, data[: int(len(data) * share)])) == "light.truncated"


def test_every_truncation_of_a_real_file_is_an_error(tmp_path: Path, assets: Path) -> None:
    data = (assets / "envmaps" / "venice_sunset_512.hdr").read_bytes()
    for length in [*range(0, 120, 7), len(data) // 3, len(data) - 1]:
        assert _code(_file(tmp_path, data[:length])) in ("light.truncated", "light.damaged")


def test_all_zero(tmp_path: Path) -> None:
    assert _code(_file(tmp_path, hdr(np.zeros((16, 32, 4), np.uint8), rle=True))) == "light.black"


@pytest.mark.parametrize("name", ["bad.hdr", "bad.exr"])
@pytest.mark.parametrize("data", [b"", b"garbage" * 50, bytes(range(256)) * 8])
def test_garbage(tmp_path: Path, name: str, data: bytes) -> None:
    assert _code(_file(tmp_path, data, name)) == "light.damaged"


def test_truncated_exr(tmp_path: Path, values: np.ndarray) -> None:
    import OpenEXR

    path = tmp_path / "light.exr"
    OpenEXR.File({}, {"RGB": values}).write(str(path))
    assert _code(_file(tmp_path, path.read_bytes()[:700], "cut.exr")) == "light.damaged"


@pytest.mark.parametrize(
    ("size", "code"),
    [
        ("-Y 100000 +X 200000", "light.size"),
        ("-Y 0 +X 0", "light.size"),
        ("-Y 16384 +X 32767", "light.truncated"),
        ("+X 32 -Y 16", "light.damaged"),
        ("-Y -16 +X 32", "light.damaged"),
        ("", "light.damaged"),
    ],
)
def test_absurd_sizes(tmp_path: Path, size: str, code: str) -> None:
    data = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size.encode() + b"\n" + b"\x02\x02\x7f\xff" * 600
    assert _code(_file(tmp_path, data)) == code


def test_other_kinds(tmp_path: Path, values: np.ndarray) -> None:
    header = "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n"
    assert _code(_file(tmp_path, hdr(encode(values), rle=True, header=header))) == "light.format"
    assert _code(_file(tmp_path, hdr(encode(values[:, :16]), rle=True))) == "light.shape"
    assert _code(_file(tmp_path, b"x", "light.png")) == "light.format"
    assert _code(tmp_path / "none.hdr") == "light.missing"
    (tmp_path / "folder.hdr").mkdir()
    assert _code(tmp_path / "folder.hdr") == "light.unreadable"


def test_run_that_overflows_its_scanline(tmp_path: Path) -> None:
    line = bytes((2, 2, 0, 32)) + bytes((128 + 60, 7)) * 8
    data = b"#?RADIANCE\n\n-Y 16 +X 32\n" + line * 16
    assert _code(_file(tmp_path, data)) == "light.truncated"


def test_from_radiance_hashes_its_values() -> None:
    ones = torch.ones(4, 8, 3)
    assert from_radiance(ones).sha256 == from_radiance(ones.clone()).sha256 != from_radiance(2 * ones).sha256


@pytest.mark.parametrize("exposure", [-1.0, math.nan])
def test_exposure_out_of_range(exposure: float) -> None:
    with pytest.raises(LightError, match="exposure"):
        load_environment("default", exposure)
