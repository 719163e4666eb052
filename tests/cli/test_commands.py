"""``inspect``, ``unwrap``, ``render``, ``export``, ``doctor`` on a painted cube."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.cli.conftest import CUBE, TINY, Ran

from paintit.cli.main import main
from paintit.mesh.read import read_mesh


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cube painted once for the whole file; its run is beside it."""
    folder = tmp_path_factory.mktemp("painted")
    (folder / "cube.obj").write_text(CUBE)
    asset = folder / "red.glb"
    assert main(["paint", str(folder / "cube.obj"), "red plastic", "-o", str(asset), *TINY, "-q"]) == 0
    return asset


def data_of(ran: Ran) -> dict[str, Any]:
    assert ran.code == 0, ran.err
    return json.loads(ran.out)["data"]


def test_inspect_a_mesh(cube: Path, paintit: Callable[..., Ran]) -> None:
    data = data_of(paintit("inspect", cube, "--json"))
    mesh = data["mesh"]
    assert (data["kind"], mesh["faces"], mesh["watertight"], mesh["uv"]["islands"]) == ("mesh", 12, True, 6)
    text = paintit("inspect", cube)
    assert text.err == ""
    assert "12, 0 degenerate" in text.out
    assert "6 islands" in text.out


def test_inspect_says_what_the_file_has_and_what_painting_makes(assets: Path, paintit: Callable[..., Ran]) -> None:
    data = data_of(paintit("inspect", assets / "meshes" / "wingnut.stl", "--json"))
    assert data["uv_in_file"]["has_uvs"] is False
    assert data["mesh"]["uv_origin"] == "unwrapped"
    assert data["mesh"]["uv"]["paintable"] is True


def test_inspect_a_painted_asset(painted: Path, paintit: Callable[..., Ran]) -> None:
    data = data_of(paintit("inspect", painted, "--json"))
    (material,) = data["materials"]
    assert set(material["textures"]) == {"baseColorTexture", "metallicRoughnessTexture", "normalTexture"}
    assert data["metadata"]["paintit"]["prompt"] == "red plastic"
    run = data_of(paintit("inspect", painted.with_suffix(".paintit"), "--json"))["run"]
    assert data["seam"]["edges"] == run["seam"]["edges"] > 0
    assert data["seam"]["seams"] == pytest.approx(run["seam"]["seams"], abs=0.4)  # the file holds 8 bits
    assert "times the difference across other edges" in paintit("inspect", painted).out


def test_inspect_a_run(painted: Path, paintit: Callable[..., Ran]) -> None:
    folder = painted.with_suffix(".paintit")
    assert data_of(paintit("inspect", folder, "--json"))["run"]["state"] == "finished"
    assert "finished after 3 of 3 steps" in paintit("inspect", folder).out


def test_unwrap_reports_before_and_after(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    report = paintit("unwrap", cube)
    assert (report.code, report.err) == (0, "")
    assert "before" in report.out.splitlines()[0]
    ran = paintit("unwrap", cube, "-o", "new.obj")
    assert (ran.code, ran.out) == (0, "new.obj\n")
    assert "coverage" in ran.err
    mesh = read_mesh(here / "new.obj", unwrap="never")
    assert len(mesh.faces) == 12
    assert data_of(paintit("unwrap", cube, "--json"))["after"]["overlap"] == pytest.approx(1.0, abs=0.01)


def test_render_a_picture(painted: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    ran = paintit("render", painted, "-o", "x.png", "--views", "3", "--size", "32", "-q")
    assert ran == Ran(0, "x.png\n", "")
    with Image.open(here / "x.png") as image:
        assert image.size == (64, 64)
    side = paintit("render", painted, "-o", "y.png", "--size", "32", "--azimuth", "80", "--elevation", "40")
    front = paintit("render", painted, "-o", "z.png", "--size", "32", "--azimuth", "0", "--elevation", "0")
    assert (side.code, front.code) == (0, 0)
    assert (here / "y.png").read_bytes() != (here / "z.png").read_bytes()


def test_render_the_camera_and_the_light(painted: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    def picture(*flags: str) -> Image.Image:
        ran = paintit("render", painted, "-o", "x.png", "--size", "32", "--overwrite", *flags)
        assert ran.code == 0, ran.err
        with Image.open(here / "x.png") as image:
            image.load()
            return image

    alpha = picture("--background", "transparent").getchannel("A").histogram()
    far = picture("--background", "transparent", "--radius", "6.5").getchannel("A").histogram()
    wide = picture("--background", "transparent", "--fov", "80").getchannel("A").histogram()
    assert alpha[255] > 2 * far[255] > 0
    assert alpha[255] > 2 * wide[255] > 0
    dark, bright = picture("--exposure", "0.2"), picture("--exposure", "0.8")
    assert dark.getpixel((0, 0)) == bright.getpixel((0, 0))
    assert sum(dark.convert("L").tobytes()) < sum(bright.convert("L").tobytes())
    assert picture("--background", "0").getpixel((0, 0)) == (0, 0, 0)
    assert picture("--background", "light").getpixel((0, 0)) != picture("--background", "light", "--rotation",
                                                                        "90").getpixel((0, 0))  # fmt: skip


def test_render_a_turntable(painted: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("render", painted, "-o", "x.webp", "--views", "3", "--size", "32").code == 0
    with Image.open(here / "x.webp") as image:
        assert getattr(image, "n_frames", 0) == 3


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--size", "-1"], "error: --size is -1; it must be from 8 to 8192"),
        (["--views", "0"], "error: --views is 0; it must be from 1 to 360"),
        (["--background", "2"], "error: --background is 2; it must be from 0 to 1"),
        (["--background", "sky"], "error: --background is 'sky'; give a grey from 0 to 1, 'light' or 'transparent'"),
        (["--fov", "0"], "error: --fov is 0; it must be from 1 to 150"),
        (["-o", "x.gif"], "error: cannot write a picture as 'x.gif'; end it with .png or .webp"),
    ],
)
def test_render_refuses(flags: list[str], line: str, painted: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("render", painted, *flags) == Ran(2, "", line + "\n")


def test_a_mesh_without_materials_cannot_be_rendered(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    line = f"error: {cube} has no materials that can be read; name a .glb, a .gltf or a run folder\n"
    assert paintit("render", cube, "-o", "x.png") == Ran(1, "", line)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("name", ["x.glb", "x.gltf", "x.obj", "maps"])
def test_export_a_run_or_an_asset(name: str, painted: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    for source in (painted, painted.with_suffix(".paintit")):
        ran = paintit("export", source, "-o", name, "--overwrite")
        assert (ran.code, ran.out) == (0, f"{name}\n")
    if name == "maps":
        ours = (here / "maps" / "base_color.png").read_bytes()
        assert ours == (painted.with_suffix(".paintit") / "textures" / "base_color.png").read_bytes()
    else:
        assert len(read_mesh(here / name, unwrap="never").faces) == 12


def test_export_a_run_that_was_stopped(cube: Path, here: Path, paintit: Callable[..., Ran]) -> None:
    from paintit.cli.paint_command import parse_arguments
    from paintit.run.paint import Request, prepare, run

    settings = parse_arguments([str(cube), "red", *TINY]).settings
    run(prepare(Request(cube, "red", settings, "stopped/")), stop=lambda: True)
    ran = paintit("export", "stopped", "-o", "x.glb")
    assert (ran.code, ran.out) == (0, "x.glb\n")
    assert "stopped after 1 of 3 steps" in ran.err


def test_export_needs_an_output(painted: Path, paintit: Callable[..., Ran]) -> None:
    assert paintit("export", painted) == Ran(2, "", "error: no output is given; add -o chair.glb, or another name\n")


def test_doctor(paintit: Callable[..., Ran], here: Path) -> None:
    ran = paintit("doctor", "--json")
    data = json.loads(ran.out)["data"]
    assert (ran.code, data["broken"]) == (0, [])
    assert "3 steps, 4 faces read back" in data["checks"]["toy run"]
    assert list(here.iterdir()) == []


def test_doctor_fails_where_something_is_broken(
    paintit: Callable[..., Ran], here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "file").touch()
    monkeypatch.setenv("PAINTIT_CACHE", str(here / "file" / "cache"))
    ran = paintit("doctor")
    assert ran.code == 1
    assert "cache     BROKEN: cannot write " in ran.out
