"""Bad input: one line on stderr that says what and what next, nothing on stdout, nothing left on disk."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.cli.conftest import CUBE, TINY, Ran, everything

GARBAGE = bytes((i * 37 + 11) % 256 for i in range(400))
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BEGINS = r"it begins with b'\x0b0Uz\x9f\xc4\xe9\x0e'"
HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n"
LIGHT_HINT = "give a latitude-longitude .hdr or .exr file, or 'default'"

FILES: dict[str, bytes] = {
    **{f"garbage.{kind}": GARBAGE for kind in ("obj", "ply", "stl", "off", "glb", "gltf")},
    **{f"empty.{kind}": b"" for kind in ("obj", "ply", "stl", "off", "glb", "gltf")},
    "cube.obj": CUBE.encode(),
    "no_faces.obj": TRIANGLE.encode(),
    "nan.obj": b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n",
    "index.obj": (TRIANGLE + "f 1 2 9\n").encode(),
    "notes.txt": b"hello",
    "short.hdr": HDR + bytes(16),
    "black.hdr": HDR + bytes(4 * 32),
    "garbage.hdr": GARBAGE,
    "settings.toml": b"[optim]\nstep = 3\n",
    "broken.toml": b"optim = \n",
}

#: Arguments after ``paint`` -> exit code and the line on stderr.
CASES: dict[str, tuple[list[str], int, str]] = {
    "missing": (["missing.obj", "red"], 1, "error: there is no file missing.obj; check the path"),
    **{
        f"empty {kind}": (
            [f"empty.{kind}", "red"], 1, f"error: empty.{kind} is empty (0 bytes); export or copy the mesh again"
        )
        for kind in ("obj", "ply", "stl", "off", "glb", "gltf")
    },
    "garbage obj": (
        ["garbage.obj", "red"], 1,
        "error: cannot read garbage.obj: the .obj file holds binary data; export the mesh again as OBJ text",
    ),
    **{
        f"garbage {kind}": (
            [f"garbage.{kind}", "red"], 1,
            f"error: cannot read garbage.{kind}: this is not {name} file ({BEGINS}); check that it is {real} file, "
            "or export it again",
        )
        for kind, name, real in (
            ("ply", "a PLY", "a PLY"), ("stl", "an STL", "an STL"), ("off", "an OFF", "a text OFF"),
            ("glb", "a GLB", "a GLB"), ("gltf", "a glTF", "a glTF"),
        )
    },
    "extension": (
        ["notes.txt", "red"], 1,
        "error: notes.txt is not a mesh file that can be read ('.txt'); use one of .obj, .ply, .stl, .off, .glb, .gltf",
    ),
    "zero faces": (
        ["no_faces.obj", "red"], 1,
        "error: cannot read no_faces.obj: the mesh has no faces (3 vertices, 0 faces); export the mesh with its faces; "
        "point clouds and curves cannot be painted",
    ),
    "nan": (
        ["nan.obj", "red"], 1,
        "error: cannot read nan.obj: vertex 2 is not finite: 'v nan 0 0' (line 2); repair the file or export it again",
    ),
    "index": (
        ["index.obj", "red"], 1,
        "error: cannot read index.obj: a face uses v 9 of 3 (line 4); repair the file or export it again",
    ),
    "truncated glb": (
        ["truncated.glb", "red"], 1,
        "error: cannot read truncated.glb: the GLB file is cut off: 880566 of 1761132 bytes; copy or download it "
        "again",
    ),
    "light missing": (
        ["cube.obj", "red", "--light", "no.hdr"], 1, f"error: there is no environment map 'no.hdr'; {LIGHT_HINT}"
    ),
    "light truncated": (
        ["cube.obj", "red", "--light", "short.hdr"], 1,
        f"error: 'short.hdr' is not a readable .hdr file: it ends before its 8 x 4 pixels do; {LIGHT_HINT}",
    ),
    "light black": (
        ["cube.obj", "red", "--light", "black.hdr"], 1,
        f"error: 'black.hdr' holds no light: every value is zero; {LIGHT_HINT}",
    ),
    "light garbage": (
        ["cube.obj", "red", "--light", "garbage.hdr"], 1,
        f"error: 'garbage.hdr' is not a readable .hdr file: it does not begin with '#?RADIANCE'; {LIGHT_HINT}",
    ),
    "prior": (
        ["cube.obj", "red", "--prior", "pockt"], 1,
        "error: there is no prior 'pockt'; did you mean pocket? known: pocket, sd21-base, sd21, sd2-depth, sd15, "
        "sdxl, sd3-medium, sd35-medium, sd35-large, klein-base, klein, z-image, z-image-turbo, deepfloyd-if; a folder "
        "or a hub id OWNER/NAME also works",
    ),
    "unwritable, under a file": (
        ["cube.obj", "red", "-o", "notes.txt/x.glb"], 1,
        "error: cannot write into notes.txt: it is a file; choose another place with -o",
    ),
    "unwritable, not a real folder": (
        ["cube.obj", "red", "-o", "/proc/x.glb"], 1,
        "error: cannot write /proc: no such file or directory; choose another place with -o",
    ),
    "unwritable, a full device": (
        ["cube.obj", "red", "-o", "/dev/full/x/"], 1,
        "error: cannot write /dev/full/x: a part of the path is a file; choose another place with -o",
    ),
    "output is the input": (
        ["cube.obj", "red", "-o", "cube.obj", "--overwrite"], 1,
        "error: cube.obj is the mesh itself; choose another name with -o",
    ),
    "output format": (
        ["cube.obj", "red", "-o", "x.fbx"], 2,
        "error: cannot write '.fbx' (x.fbx); end the name with .glb, .gltf, .obj, or with / for a folder",
    ),
    "no mesh": ([], 2, 'error: no mesh is given; write: paintit paint MESH "PROMPT"'),
    "empty prompt": (
        ["cube.obj", "  "], 2, 'error: the prompt is empty; say what the mesh should look like: "red plastic"'
    ),
    "no prompt": (
        ["cube.obj"], 2, 'error: the prompt is empty; say what the mesh should look like: "red plastic"'
    ),
    "unquoted prompt": (
        ["cube.obj", "red", "plastic"], 2,
        "error: unexpected argument 'plastic'; put quotes around a prompt of several words",
    ),
    "negative texture": (
        ["cube.obj", "red", "--texture-size", "-5"], 2, "error: texture.size is -5; it must be from 8 to 8192"
    ),
    "negative views": (["cube.obj", "red", "--views=-1"], 2, "error: views.count is -1; it must be from 1 to 256"),
    "negative steps": (
        ["cube.obj", "red", "--steps", "-3"], 2, "error: optim.steps is -3; it must be from 1 to 10000000"
    ),
    "render size": (["cube.obj", "red", "--render-size", "0"], 2, "error: views.size is 0; it must be from 8 to 8192"),
    "odd size": (
        ["cube.obj", "red", "--texture-size", "100", "--texture.widths", "8", "8", "8", "--texture.skip-widths", "4",
         "4", "4"], 2, "error: texture.size is 100; 3 levels at 1/2 of it need a multiple of 16, at least 32, "
        "for example 96",
    ),
    "not a number": (
        ["cube.obj", "red", "--steps", "many"], 2, "error: --steps is 'many'; it must be a whole number"
    ),
    "learning rate": (["cube.obj", "red", "--optim.lr", "nan"], 2, "error: optim.lr is nan; it must be greater than 0"),
    "choice": (["cube.obj", "red", "--dtype", "float"], 2, "error: --dtype is 'float'; did you mean 'float32'?"),
    "preset": (["cube.obj", "red", "--preset", "papre"], 2, "error: --preset is 'papre'; did you mean 'paper'?"),
    "no value": (["cube.obj", "red", "--steps"], 2, "error: --steps has too few values; it takes 1"),
    "misspelt": (["cube.obj", "red", "--stpes", "3"], 2, "error: unknown flag --stpes; did you mean --steps?"),
    "misspelt, nested": (
        ["--texture.sise", "3", "cube.obj", "red"], 2,
        "error: unknown flag --texture.sise; did you mean --texture.size?",
    ),
    "misspelt, global": (["cube.obj", "red", "--jsno"], 2, "error: unknown flag --jsno; did you mean --json?"),
    "nothing like it": (
        ["cube.obj", "red", "--xyzzy"], 2, "error: unknown flag --xyzzy; 'paintit paint --help' lists them"
    ),
    "focus": (
        ["cube.obj", "red", "--focus", "1,2"], 2,
        "error: --focus is '1,2'; write x,y,z,radius or x,y,z,radius,name",
    ),
    "device": (
        ["cube.obj", "red", "--device", "gpu"], 2,
        'error: device is "gpu"; choose auto, cpu, cuda, cuda:N, mps, or several GPUs as cuda:0,cuda:1'
    ),
    "devices, one empty": (
        ["cube.obj", "red", "--device", "cuda:0,"], 2,
        'error: device is "cuda:0,"; choose auto, cpu, cuda, cuda:N, mps, or several GPUs as cuda:0,cuda:1'
    ),
    "devices of two kinds": (
        ["cube.obj", "red", "--device", "cuda:0,cpu"], 2,
        "error: devices 'cuda:0,cpu' are not of one kind; name GPUs only: cuda:0,cuda:1",
    ),
    "a device twice": (
        ["cube.obj", "red", "--device", "cuda,cuda:0"], 2,
        "error: devices 'cuda,cuda:0' name one twice; name each GPU once: cuda:0,cuda:1",
    ),
    "resume nothing": (
        ["--resume", "nowhere"], 1,
        "error: nowhere is not a run folder: it has no run.json; give the folder that paint made",
    ),
    "resume with settings": (
        ["--resume", "nowhere", "--preset", "paper"], 2,
        "error: --resume keeps the settings of its run; leave out --preset and --config",
    ),
    "offline": (
        ["cube.obj", "red", "--offline", "--allow-download"], 2,
        "error: --offline and --allow-download contradict each other; leave one out",
    ),
    "settings": (
        ["cube.obj", "red", "--config", "settings.toml"], 2,
        "error: settings.toml: unknown setting 'optim.step'; did you mean 'optim.steps'?",
    ),
    "settings missing": (
        ["cube.obj", "red", "--config", "no.toml"], 2,
        "error: cannot read settings from no.toml: no such file or directory; check the path",
    ),
    "settings broken": (
        ["cube.obj", "red", "--config", "broken.toml"], 2,
        "error: broken.toml is not TOML: Invalid value (at line 1, column 9); correct that line",
    ),
}  # fmt: skip


@pytest.fixture
def bad(here: Path, assets: Path) -> Path:
    """A working folder full of broken files."""
    for name, data in FILES.items():
        (here / name).write_bytes(data)
    avocado = (assets / "meshes" / "avocado.glb").read_bytes()
    (here / "truncated.glb").write_bytes(avocado[: len(avocado) // 2])
    return here


@pytest.mark.parametrize("name", CASES)
def test_one_line(name: str, bad: Path, paintit: Callable[..., Ran]) -> None:
    arguments, code, line = CASES[name]
    before = everything(bad)
    ran = paintit("paint", *arguments, "-q")
    assert ran == Ran(code, "", line + "\n")
    assert everything(bad) == before


@pytest.mark.parametrize("name", ["missing", "truncated glb", "light black", "misspelt", "empty prompt"])
def test_the_same_in_a_document(name: str, bad: Path, paintit: Callable[..., Ran]) -> None:
    arguments, code, line = CASES[name]
    ran = paintit("--json", "paint", *arguments, "-q")
    document = json.loads(ran.out)
    assert ran.out.count("\n") == 1
    assert ran.code == code
    assert document["ok"] is False
    error = document["error"]
    assert "." in error["code"]
    assert f"error: {error['message']}; {error['hint']}" == line == ran.err.strip()


@pytest.mark.parametrize("name", ["missing", "unwritable, under a file", "misspelt"])
def test_a_true_process(name: str, bad: Path) -> None:
    arguments, code, line = CASES[name]
    before = everything(bad)
    done = subprocess.run(
        [sys.executable, "-m", "paintit", "paint", *arguments], cwd=bad, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", line + "\n")
    assert everything(bad) == before


def test_an_existing_result_is_kept(bad: Path, paintit: Callable[..., Ran]) -> None:
    (bad / "out.glb").write_bytes(b"precious")
    ran = paintit("paint", "cube.obj", "red", "-o", "out.glb")
    assert ran == Ran(1, "", "error: out.glb exists already; add --overwrite or choose another -o\n")
    assert (bad / "out.glb").read_bytes() == b"precious"


def test_overwrite_never_removes_what_no_run_made(bad: Path, paintit: Callable[..., Ran]) -> None:
    (bad / "textures").mkdir()
    (bad / "textures" / "mine.png").write_bytes(b"precious")
    ran = paintit("paint", "cube.obj", "red", "-o", ".", "--overwrite")
    assert ran == Ran(1, "", "error: textures is there and no run of paintit made it; choose another -o\n")
    assert (bad / "textures" / "mine.png").read_bytes() == b"precious"


def test_an_unknown_command_names_the_nearest(paintit: Callable[..., Ran]) -> None:
    assert paintit("pain", "x") == Ran(2, "", "error: unknown command 'pain'; did you mean 'paint'?\n")


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (
            MemoryError(),
            "error: there is not enough memory; use a smaller --texture-size, --render-size or --views; --dry-run "
            "shows an estimate\n",
        ),
        (
            ZeroDivisionError("division by zero"),
            "error: internal error: ZeroDivisionError: division by zero; run with -v for the traceback, and please "
            "report it\n",
        ),
    ],
)
def test_the_unexpected_is_one_line_too(
    error: Exception, line: str, bad: Path, paintit: Callable[..., Ran], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("paintit.api.load_mesh", fail)
    assert paintit("paint", "cube.obj", "red", *TINY) == Ran(1, "", line)
    verbose = paintit("paint", "cube.obj", "red", *TINY, "-v")
    assert "Traceback" in verbose.err
    assert verbose.err.endswith(line)


def test_torch_out_of_memory_is_recognised() -> None:
    import torch

    from paintit.cli.main import out_of_memory

    with pytest.raises(RuntimeError) as caught:
        torch.empty(1 << 60)
    known = out_of_memory(caught.value)
    assert known is not None
    assert known.code == "memory.exhausted"
    assert out_of_memory(RuntimeError("shapes differ")) is None
