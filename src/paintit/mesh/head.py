"""Where a rigged body has its head, by the name of a joint: what a portrait painter would look at."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_schema import plain
from paintit.mesh.mesh import Floats, Head, Ints

#: Words beside "head" that make it something else: the tip of the chain, a control, a thing that is worn or held.
_OTHER = frozenset(
    {
        *("top", "end", "nub", "tip", "leaf", "fore", "hair"),
        *("ctrl", "control", "controller", "ik", "fk", "pole", "target", "effector", "aim", "look", "dummy"),
        *("set", "gear", "band", "phones", "light", "lamp", "shower", "arrow", "spear", "hammer", "axe"),
    }
)
#: The human rig of Rigify has no joint of that name; its head is the seventh bone of the spine.
_RIGIFY = re.compile(r"(?:DEF|ORG)[-_.]?spine[-_.]?006")
#: A head of more than this share of the mesh's longest edge is the mesh itself: looking at it again helps nobody.
_MAX_SHARE = 0.7


@dataclass(frozen=True)
class Joint:
    """A joint and the nodes at or below it."""

    name: str
    below: frozenset[int]


def is_head(name: str) -> bool:
    """Whether a joint's name means the head, in the spelling of the usual rigs.

    >>> [is_head(n) for n in ("mixamorig:Head", "b_Head_05", "J_Bip_C_Head", "CC_Base_Head", "Bip01 Head", "head.x")]
    [True, True, True, True, True, True]
    >>> [is_head(n) for n in ("mixamorig:HeadTop_End", "headset", "ForeHead", "head_end", "Bip01 HeadNub", "neck")]
    [False, False, False, False, False, False]
    """
    words = _words(name)
    return "head" in words and not _OTHER & set(words)


def _words(name: str) -> list[str]:
    """Lower-case words of ``name``, cut at separators, digits and capitals."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def find_head(document: GltfDocument) -> Joint | None:
    """The joint of the document's skins that is the head: the plainest name, then the one nearest to the root."""
    nodes = document.items("nodes")
    joints = sorted({joint for skin in document.items("skins") for joint in skin.get("joints", [])})
    names = {joint: str(nodes[joint].get("name", "")) for joint in joints}
    found = [joint for joint in joints if is_head(names[joint])]
    found = found or [joint for joint in joints if _RIGIFY.fullmatch(names[joint])]
    if not found:
        return None
    parent = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}

    def depth(joint: int) -> int:
        steps = 0
        while joint in parent:
            joint, steps = parent[joint], steps + 1
        return steps

    best = min(found, key=lambda joint: (len(_words(names[joint])), depth(joint), joint))
    below: set[int] = set()
    todo = [best]
    while todo:
        joint = todo.pop()
        below.add(joint)
        todo += nodes[joint].get("children", [])
    return Joint(plain(names[best]), frozenset(below))


def head_of(joint: Joint | None, pieces: Sequence[tuple[Floats, Ints, NDArray[np.bool_] | None]]) -> Head | None:
    """The box around the vertices that mostly follow ``joint`` and what hangs on it.

    Args:
        joint: the head's joint; None: there is none.
        pieces: world positions (n, 3), faces (f, 3) and whether each vertex is on the head (None: no skin).
    """
    if joint is None:
        return None
    mine, all_ = [np.zeros((0, 3))], []
    for positions, faces, on_head in pieces:
        used = np.unique(faces)
        all_.append(positions[used])
        if on_head is not None:
            mine.append(positions[used[on_head[used]]])
    head, body = np.concatenate(mine), np.concatenate(all_)
    if len(head) < 3:
        return None
    low, high = head.min(0), head.max(0)
    edge = float((high - low).max())
    if not 0 < edge <= _MAX_SHARE * float(np.ptp(body, axis=0).max()):
        return None
    x, y, z = ((low + high) / 2).tolist()
    return Head(joint.name, (x, y, z), edge / 2)
