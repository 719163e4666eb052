"""One moment of a glTF animation, as changes to the nodes; the document itself is left alone (glTF 2.0, 3.11)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from paintit.errors import MeshError
from paintit.mesh.gltf_document import GltfDocument
from paintit.mesh.gltf_schema import gltf_error, plain
from paintit.mesh.mesh import Floats

REST = "rest"
_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}


def pose_changes(document: GltfDocument, pose: str, notes: list[str]) -> dict[int, dict[str, Any]]:
    """Members that nodes have in ``pose``, by node.

    Args:
        document: the file.
        pose: ``rest`` (no change); ``NAME@SECONDS``, where NAME may be an animation's number; ``NAME`` for its start;
            ``@SECONDS`` of the first animation.
        notes: what is left out is added to it.

    Raises:
        MeshError: ``mesh.pose``, there is no such animation, or the time is not a number; ``mesh.gltf_invalid``, its
            keyframes are damaged.
    """
    if pose == REST:
        return {}
    index, seconds = _find(document, pose)
    animation = document.items("animations")[index]
    changes: dict[int, dict[str, Any]] = {}
    known: dict[int, tuple[Floats, Floats]] = {}
    pointers, last = 0, 0.0
    for channel in animation.get("channels", []):
        target = channel.get("target", {})
        path, node = target.get("path"), target.get("node")
        pointers += path == "pointer"
        if node is None or path not in (*_WIDTHS, "weights"):
            continue
        sampler = channel["sampler"]
        if sampler not in known:
            known[sampler] = _keyframes(document, animation["samplers"][sampler], f"animation {index}")
        times, values = known[sampler]
        last = max(last, float(times[-1]))
        how = animation["samplers"][sampler].get("interpolation", "LINEAR")
        value = sample(times, values, how, seconds, rotation=path == "rotation")
        if path in _WIDTHS and value.shape != (_WIDTHS[path],):
            raise gltf_error("gltf_invalid", f"animation {index} has {len(value)} numbers for '{path}' of node {node}")
        changes.setdefault(node, {})[path] = value.tolist()
    _check_matrices(document, changes)
    if pointers:
        notes.append(f"left out {pointers} channels of the animation: KHR_animation_pointer does not move vertices")
    name = plain(str(animation.get("name") or index))
    after = f", which ends at {last:g} s" if seconds > last else ""
    notes.append(f"posed as in animation '{name}' at {seconds:g} s{after}")
    return changes


def _check_matrices(document: GltfDocument, changes: dict[int, dict[str, Any]]) -> None:
    for node, change in changes.items():
        if "matrix" in document.item("nodes", node) and set(change) & set(_WIDTHS):
            raise gltf_error("gltf_invalid", f"node {node} is animated but has a matrix")


def _find(document: GltfDocument, pose: str) -> tuple[int, float]:
    """Index of the animation that ``pose`` names, and the time."""
    names = [str(animation.get("name", "")) for animation in document.items("animations")]
    if not names:
        raise MeshError("mesh.pose", f"the file has no animation to take the pose '{plain(pose)}' from",
                        "leave --pose out")  # fmt: skip
    name, at, time = ("", "", "") if pose in names else pose.rpartition("@")
    if not at:
        name, time = pose, "0"
    try:
        seconds = float(time)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise MeshError("mesh.pose", f"the pose '{plain(pose)}' has no time in seconds", "write NAME@SECONDS")
    if name and name in names:
        return names.index(name), seconds
    if (at and not name) or (name.isascii() and name.isdigit() and int(name[:9]) < len(names)):
        return int(name or 0), seconds
    listed = ", ".join(plain(known) or str(i) for i, known in enumerate(names[:20]))
    more = f" and {len(names) - 20} more" if len(names) > 20 else ""
    raise MeshError("mesh.pose", f"there is no animation '{plain(name)}'", f"choose rest or one of {listed}{more}")


def _keyframes(document: GltfDocument, sampler: dict[str, Any], owner: str) -> tuple[Floats, Floats]:
    """Times (k,) and values (k, m) of a sampler; a cubic spline has (k, 3, m): in-tangent, value, out-tangent."""
    times = document.accessor(sampler["input"]).astype(np.float64)
    values = document.accessor(sampler["output"]).astype(np.float64).reshape(-1)
    if times.shape[1] != 1 or not np.isfinite(times).all() or (np.diff(times[:, 0]) < 0).any():
        raise gltf_error("gltf_invalid", f"{owner} has keyframes whose times do not increase")
    shape: tuple[int, ...] = (len(times), 3, -1) if sampler.get("interpolation") == "CUBICSPLINE" else (len(times), -1)
    unit = math.prod(shape[:-1])
    if len(values) % unit or not len(values) or not np.isfinite(values).all():
        raise gltf_error("gltf_invalid", f"{owner} has {len(values)} numbers for {len(times)} keyframes")
    return times[:, 0], values.reshape(shape)


def sample(times: Floats, values: NDArray[np.float64], how: str, time: float, *, rotation: bool = False) -> Floats:
    """(m,) value of a sampler at ``time``, held before the first and after the last keyframe (glTF 2.0, appendix C).

    Args:
        times: (k,) seconds, increasing.
        values: (k, m), or (k, 3, m) for ``CUBICSPLINE``.
        how: ``STEP``, ``CUBICSPLINE``; anything else is linear.
        time: seconds.
        rotation: the values are quaternions: linear means along the arc, and the result has unit length.
    """
    cubic = how == "CUBICSPLINE"
    keys = values[:, 1] if cubic else values
    i = int(np.searchsorted(times, time, side="right")) - 1
    if i < 0 or i >= len(times) - 1 or how == "STEP":
        value = keys[min(max(i, 0), len(times) - 1)]
    else:
        span = times[i + 1] - times[i]
        t = (time - times[i]) / span
        if cubic:
            value = (
                (2 * t**3 - 3 * t**2 + 1) * keys[i] + span * (t**3 - 2 * t**2 + t) * values[i, 2]
                + (-2 * t**3 + 3 * t**2) * keys[i + 1] + span * (t**3 - t**2) * values[i + 1, 0]
            )  # fmt: skip
        elif rotation:
            value = _slerp(keys[i], keys[i + 1], t)
        else:
            value = (1 - t) * keys[i] + t * keys[i + 1]
    if rotation:
        value = value / max(float(np.linalg.norm(value)), 1e-30)
    return value


def _slerp(a: Floats, b: Floats, t: float) -> Floats:
    """Along the shorter arc from quaternion ``a`` to ``b``."""
    a, b = a / max(float(np.linalg.norm(a)), 1e-30), b / max(float(np.linalg.norm(b)), 1e-30)
    dot = float(a @ b)
    angle = math.acos(min(abs(dot), 1.0))
    if angle < 1e-6:
        return (1 - t) * a + t * math.copysign(1.0, dot) * b
    return (math.sin((1 - t) * angle) * a + math.copysign(1.0, dot) * math.sin(t * angle) * b) / math.sin(angle)
