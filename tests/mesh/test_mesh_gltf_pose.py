"""A moment of an animation, against values worked out by hand and against Blender's own evaluation."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.mesh.glb_builder import QUAD, Builder, quad

from paintit.errors import MeshError
from paintit.mesh.pose import sample
from paintit.mesh.read import read_mesh

HALF = math.sqrt(0.5)
TURN = [[0, 0, 0, 1], [0, 0, HALF, HALF]]
"""Quaternions: none, and a quarter turn about +Z."""


def animated(path: str, times: list[float], values: Any, code: str = "f", how: str = "LINEAR", **extra: Any) -> Builder:
    """A square one of whose node's members is animated."""
    b = quad()
    add(b, "Move", path, times, values, code, how, **extra)
    return b


def add(
    b: Builder,
    name: str,
    path: str,
    times: list[float],
    values: Any,
    code: str = "f",
    how: str = "LINEAR",
    **extra: Any,
) -> None:
    sampler = {"input": b.accessor(times), "output": b.accessor(values, code, **extra), "interpolation": how}
    b.json.setdefault("animations", []).append(
        {"name": name, "samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 0, "path": path}}]}
    )


def corners(b: Builder, tmp_path: Path, pose: str) -> np.ndarray:
    return read_mesh(b.glb(tmp_path / "a.glb"), pose=pose).vertices


def along_x(x: float) -> np.ndarray:
    return np.add(QUAD, [x, 0, 0])


@pytest.mark.parametrize(
    ("pose", "x"),
    [("rest", 0), ("Move@1.5", 1.0), ("Move", 0.0), ("0@2", 2.0), ("@2", 2.0), ("Move@-9", 0.0), ("Move@99", 4.0)],
)
def test_linear_translation(tmp_path: Path, pose: str, x: float) -> None:
    b = animated("translation", [1, 2, 3], [[0, 0, 0], [2, 0, 0], [4, 0, 0]])
    np.testing.assert_allclose(corners(b, tmp_path, pose), along_x(x))


def test_step(tmp_path: Path) -> None:
    b = animated("scale", [0, 1], [[1, 1, 1], [3, 3, 3]], how="STEP")
    np.testing.assert_allclose(corners(b, tmp_path, "Move@0.99"), QUAD)
    np.testing.assert_allclose(corners(b, tmp_path, "Move@1"), 3 * np.array(QUAD))


def test_cubic_spline(tmp_path: Path) -> None:
    """From 0 to 1 within 2 s, leaving with slope 3 and arriving with slope 0: by hand 1/2 + 2 * 3/8 in the middle."""
    key = [[9, 9, 9], [0, 0, 0], [3, 0, 0], [0, 0, 0], [1, 0, 0], [9, 9, 9]]
    b = animated("translation", [0, 2], key, how="CUBICSPLINE")
    np.testing.assert_allclose(corners(b, tmp_path, "Move@1"), along_x(0.5 + 2 * 3 / 8), atol=1e-12)
    np.testing.assert_allclose(corners(b, tmp_path, "Move@2"), along_x(1))


@pytest.mark.parametrize("code", ["f", "h", "b"])
@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_goes_along_the_shorter_arc(tmp_path: Path, code: str, sign: int) -> None:
    """A third of a quarter turn is 30 degrees, whatever the sign of the quaternion and however it is stored."""
    limit = {"f": 1, "h": 32767, "b": 127}[code]
    values = np.rint(np.array(TURN) * [[1], [sign]] * limit) if limit > 1 else np.array(TURN) * [[1], [sign]]
    b = animated("rotation", [0, 3], values, code, **({"normalized": True} if limit > 1 else {}))
    if code == "b":
        b.json["bufferViews"][-1]["byteStride"] = 4
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    found = corners(b, tmp_path, "Move@1")
    np.testing.assert_allclose(
        found, np.array(QUAD) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T, atol=4e-3 / limit
    )


def test_morph_weights(tmp_path: Path) -> None:
    b = animated("weights", [0, 1], [0, 0, 1, 0.5])
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": b.accessor([[0, 0, z]] * 4)} for z in (2, 8)]
    np.testing.assert_allclose(corners(b, tmp_path, "Move@0.5")[:, 2], 0.5 * 2 + 0.25 * 8)


def test_a_skin_follows_its_joints_and_the_document_stays(tmp_path: Path) -> None:
    b = quad(skin=0)
    attributes = b.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = b.accessor([[0, 1, 0, 0]] * 4, "B")
    attributes["WEIGHTS_0"] = b.accessor([[1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0]])
    b.json["nodes"] += [{}, {}]
    b.json["skins"] = [{"joints": [1, 2]}]
    b.json["scenes"] = [{"nodes": [0, 1, 2]}]
    add(b, "Lift", "translation", [0, 1], [[0, 0, 0], [0, 0, 4]])
    b.json["animations"][0]["channels"][0]["target"]["node"] = 2
    mesh = read_mesh(b.glb(tmp_path / "a.glb"), pose="Lift@0.5")
    np.testing.assert_allclose(mesh.vertices[:, 2], [0, 0, 2, 1])
    assert mesh.source is not None
    assert mesh.source.document.json["nodes"][2] == {}
    assert mesh.report.notes[0] == "posed as in animation 'Lift' at 0.5 s"


def test_notes_on_time_and_pointers(tmp_path: Path) -> None:
    b = animated("translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    b.json["animations"][0]["channels"].append(
        {"sampler": 0, "target": {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/nodes/0"}}}}
    )
    assert read_mesh(b.glb(tmp_path / "a.glb"), pose="Move@7").report.notes[:2] == (
        "left out 1 channels of the animation: KHR_animation_pointer does not move vertices",
        "posed as in animation 'Move' at 7 s, which ends at 1 s",
    )


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ("Jump", "there is no animation 'Jump'; choose rest or one of Move, 1, a@b"),
        ("Jump@1", "there is no animation 'Jump'; choose rest or one of Move, 1, a@b"),
        ("7", "there is no animation '7'; choose rest or one of Move, 1, a@b"),
        ("", "there is no animation ''; choose rest or one of Move, 1, a@b"),
        ("Move@soon", "the pose 'Move@soon' has no time in seconds; write NAME@SECONDS"),
        ("Move@nan", "the pose 'Move@nan' has no time in seconds; write NAME@SECONDS"),
    ],
)
def test_unknown_poses(tmp_path: Path, pose: str, message: str) -> None:
    b = animated("translation", [0], [[0, 0, 5]])
    add(b, "", "translation", [0], [[0, 0, 6]])
    add(b, "a@b", "translation", [0], [[0, 0, 7]])
    assert corners(b, tmp_path, "1")[0, 2] == 6
    assert corners(b, tmp_path, "a@b")[0, 2] == corners(b, tmp_path, "a@b@3")[0, 2] == 7
    with pytest.raises(MeshError) as error:
        corners(b, tmp_path, pose)
    assert str(error.value) == f"cannot read {tmp_path / 'a.glb'}: {message}"
    assert error.value.code == "mesh.pose"


def test_files_without_animations(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="the file has no animation to take the pose 'Walk' from; leave --pose out"):
        read_mesh(quad().glb(tmp_path / "a.glb"), pose="Walk")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(MeshError, match=r"a \.obj file has no animation to take a pose from; leave --pose out"):
        read_mesh(tmp_path / "a.obj", pose="Walk")


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([1, 0], [[0, 0, 0]] * 2, "animation 0 has keyframes whose times do not increase"),
        ([0, float("nan")], [[0, 0, 0]] * 2, "animation 0 has keyframes whose times do not increase"),
        ([0, 1], [[0, 0, float("inf")]] * 2, "animation 0 has 6 numbers for 2 keyframes"),
        ([0, 1], [0, 1, 2], "animation 0 has 3 numbers for 2 keyframes"),
        ([0, 1], [0, 1], "animation 0 has 1 numbers for 'translation' of node 0"),
    ],
)
def test_damaged_keyframes(tmp_path: Path, times: list[float], values: Any, message: str) -> None:
    b = animated("translation", times, values)
    with pytest.raises(MeshError) as error:
        corners(b, tmp_path, "Move@0.5")
    assert error.value.message == f"cannot read {tmp_path / 'a.glb'}: {message}"


def test_a_node_with_a_matrix_cannot_be_animated(tmp_path: Path) -> None:
    b = animated("translation", [0], [[0, 0, 5]])
    b.json["nodes"][0]["matrix"] = np.eye(4).ravel().tolist()
    with pytest.raises(MeshError, match="node 0 is animated but has a matrix"):
        corners(b, tmp_path, "Move")


def test_opposite_quaternions_give_no_nan() -> None:
    times, values = np.array([0.0, 1.0]), np.array([[0, 0, 0, 1.0], [0, 0, 0, -1.0]])
    np.testing.assert_allclose(sample(times, values, "LINEAR", 0.5, rotation=True), [0, 0, 0, 1])
    assert np.isfinite(sample(times, values * 0, "LINEAR", 0.5, rotation=True)).all()


BLENDER = """
import json, sys, bpy, numpy as np
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
rig = next(o for o in bpy.data.objects if o.type == "ARMATURE")
body = next(o for o in bpy.data.objects if o.type == "MESH" and o.find_armature())
for track in rig.animation_data.nla_tracks:
    track.mute = True
out = []
for name, seconds in json.loads(sys.argv[2]):
    rig.animation_data.action = next(a for a in bpy.data.actions if a.name.startswith(name))
    if hasattr(rig.animation_data, "action_slot"):
        rig.animation_data.action_slot = rig.animation_data.action.slots[0]
    frame = seconds * bpy.context.scene.render.fps
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
    seen = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.array([(seen.matrix_world @ v.co)[:] for v in seen.data.vertices])
    out.append(np.stack([points[:, 0], points[:, 2], -points[:, 1]], 1).tolist())  # Blender's +Z is up
print("POINTS" + json.dumps(out))
"""


@pytest.mark.slow
@pytest.mark.judge
def test_fox_as_blender_poses_it(assets: Path, tmp_path: Path) -> None:
    """Every vertex of ours lies on one of Blender's, within a millionth of the fox's length, and conversely."""
    path, moments = assets / "meshes" / "fox.glb", [("Walk", 0.25), ("Run", 0.5)]
    (tmp_path / "pose.py").write_text(BLENDER)
    done = subprocess.run(
        [sys.executable, tmp_path / "pose.py", path, json.dumps(moments)], capture_output=True, text=True, timeout=300
    )
    line = next((line for line in done.stdout.splitlines() if line.startswith("POINTS")), None)
    assert line is not None, done.stderr[-1000:]
    rest = read_mesh(path)
    for (name, seconds), points in zip(moments, json.loads(line.removeprefix("POINTS")), strict=True):
        ours, theirs = read_mesh(path, pose=f"{name}@{seconds}").vertices, np.array(points)
        assert np.abs(ours - rest.vertices).max() > 5  # centimetres: it does move
        distance = np.linalg.norm(ours[:, None] - theirs, axis=-1)
        assert max(distance.min(0).max(), distance.min(1).max()) < 1e-6 * rest.extent
