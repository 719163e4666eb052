"""The head of a rigged body: which joint it is, where it lies, and that a paint looks at it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.mesh.glb_builder import Builder

from paintit.config import POCKET, FocusConfig, ViewConfig
from paintit.mesh.head import is_head
from paintit.mesh.mesh import Mesh
from paintit.mesh.read import read_mesh
from paintit.paint.views import ViewSampler, focus_note, focus_regions

HEADS = (
    "mixamorig:Head", "mixamorig1:Head", "Head", "head", "HEAD", "Bip01 Head", "Bip001_Head", "b_Head_05",
    "J_Bip_C_Head", "CC_Base_Head", "head.x", "DEF-head", "Armature_Head", "Head_07", "FBHead", "Head.001",
)  # fmt: skip
OTHERS = (
    "mixamorig:HeadTop_End", "headset", "ForeHead", "forehead", "head_end", "Head_end_leaf", "Bip01 HeadNub",
    "HeadTop", "Kopf", "neck", "b_Neck_04", "Head_IK", "head-ctrl", "overhead", "arrow_head", "spine.006", "",
)  # fmt: skip


@pytest.mark.parametrize("name", HEADS)
def test_names_of_heads(name: str) -> None:
    assert is_head(name)


@pytest.mark.parametrize("name", OTHERS)
def test_names_of_other_joints(name: str) -> None:
    assert not is_head(name)


def body(*names: str) -> Builder:
    """A tower of unit cubes' fronts, one on each joint; joint k lies at height k and hangs on joint k - 1."""
    b = Builder()
    count = len(names)
    height = np.repeat(np.arange(count), 4)
    square = np.array([[-0.5, 0, 0], [0.5, 0, 0], [0.5, 1, 0], [-0.5, 1, 0]])
    points = np.tile(square, (count, 1)) + height[:, None] * [0, 1, 0]
    joints = np.stack([height, *[np.zeros_like(height)] * 3], 1)
    faces = (np.arange(count)[:, None] * 4 + [0, 1, 2, 0, 2, 3]).ravel()
    bind = np.tile(np.eye(4), (count, 1, 1))
    bind[:, 3, 1] = -np.arange(count)
    attributes = {
        "POSITION": b.accessor(points),
        "JOINTS_0": b.accessor(joints, "B"),
        "WEIGHTS_0": b.accessor(np.tile([0.9, 0, 0, 0], (len(points), 1))),
    }
    b.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": b.accessor(faces, "H")}]}]
    b.json["nodes"] = [{"name": name, "translation": [0, min(k, 1), 0]} for k, name in enumerate(names)]
    for k in range(count - 1):
        b.json["nodes"][k]["children"] = [k + 1]
    b.json["nodes"].append({"mesh": 0, "skin": 0})
    b.json["skins"] = [{"joints": list(range(count)), "inverseBindMatrices": b.accessor(bind.reshape(-1, 16))}]
    return b


def read(b: Builder, path: Path, pose: str = "rest") -> Mesh:
    return read_mesh(b.glb(path / "a.glb"), pose=pose)


@pytest.mark.parametrize(
    ("names", "joint"),
    [
        (("mixamorig:Hips", "mixamorig:Spine", "mixamorig:Head", "mixamorig:HeadTop_End"), "mixamorig:Head"),
        (("J_Bip_C_Hips", "J_Bip_C_Neck", "J_Bip_C_Head", "J_Adj_FaceEye"), "J_Bip_C_Head"),
        (("CC_Base_Hip", "CC_Base_NeckTwist02", "CC_Base_Head", "CC_Base_FacialBone"), "CC_Base_Head"),
        (("root", "DEF-spine.005", "DEF-spine.006", "DEF-jaw"), "DEF-spine.006"),
        (("a", "b", "Head", "Head_Jaw"), "Head"),
    ],
)
def test_the_joint_and_what_hangs_on_it(tmp_path: Path, names: tuple[str, ...], joint: str) -> None:
    head = read(body(*names), tmp_path).head
    assert head is not None
    assert head.joint == joint
    np.testing.assert_allclose(head.center, [0, 3, 0], atol=1e-6)  # two squares, from 2 to 4
    assert head.radius == pytest.approx(1.0)


def test_the_head_goes_where_the_pose_takes_it(tmp_path: Path) -> None:
    b = body("hip", "spine", "head")
    sampler = {"input": b.accessor([0]), "output": b.accessor([[7, 1, 0]])}
    b.json["animations"] = [
        {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}]}
    ]
    head = read(b, tmp_path, "@0").head
    assert head is not None
    np.testing.assert_allclose(head.center, [7, 2.5, 0], atol=1e-6)


@pytest.mark.parametrize(
    "names",
    [("hip", "spine", "neck"), ("head", "jaw", "eye"), ("hip", "spine", "headset")],
    ids=["no head", "nothing but a head", "a headset"],
)
def test_no_head(tmp_path: Path, names: tuple[str, ...]) -> None:
    assert read(body(*names), tmp_path).head is None


def test_real_rigs(assets: Path) -> None:
    fox = read_mesh(assets / "meshes" / "fox.glb")
    assert fox.head is not None
    assert fox.head.joint == "b_Head_05"
    x, y, z = fox.head.center
    low, high = fox.bounds
    assert abs(x) < 0.05 * fox.extent
    assert y > low[1] + 0.6 * (high - low)[1]  # high up, and in front: a fox looks along +Z
    assert z > low[2] + 0.75 * (high - low)[2]
    assert 0.08 < fox.head.radius / fox.extent < 0.25
    assert read_mesh(assets / "meshes" / "rigged_figure.glb").head is None  # its joints have no names


def test_focus_by_itself_by_hand_and_not_at_all(tmp_path: Path) -> None:
    mesh = read(body("hip", "spine", "chest", "Head"), tmp_path)
    assert focus_regions(mesh, ViewConfig()) == (FocusConfig((0.0, 3.5, 0.0), 0.5, "face"),)
    assert focus_note(mesh, ViewConfig()) == "focus on the head (joint 'Head'); --no-focus turns it off"
    hand = (FocusConfig((0.0, 0.5, 0.0), 0.2, "left foot"),)
    assert focus_regions(mesh, ViewConfig(focus=hand)) == hand
    assert focus_note(mesh, ViewConfig(focus=hand)) == ""
    assert focus_regions(mesh, ViewConfig(auto_focus=False)) == ()
    assert focus_note(dataclasses.replace(mesh, head=None), ViewConfig()) == ""


def test_half_of_the_views_look_at_the_head(tmp_path: Path) -> None:
    mesh = read(body("hip", "spine", "chest", "Head"), tmp_path)
    views = ViewSampler(mesh, dataclasses.replace(POCKET.views, count=4))(torch.Generator().manual_seed(0))
    assert views.focus == ("", "", "face", "face")
    # Normalised: the tower is 4 high, so its middle is 0 and the head's middle 3/4; from a quarter of the distance.
    np.testing.assert_allclose(views.cameras.target[2:], [[0, 0.75, 0]] * 2, atol=1e-6)
    distance = (views.cameras.eye - views.cameras.target)[2:].norm(dim=-1)
    np.testing.assert_allclose(distance, POCKET.views.radius * 0.25, rtol=1e-5)
