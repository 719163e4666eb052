"""Which materials are painted: ``--material`` and ``--exclude``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from paintit.errors import UsageError
from paintit.mesh.mesh import Layer, Mesh


def choose(layers: tuple[Layer, ...], materials: Sequence[str], exclude: Sequence[str]) -> tuple[Layer, ...]:
    """``layers`` with ``painted`` set: those named in ``materials`` (all where it is empty) but not in ``exclude``.

    A name is exact, or differs in case alone from just one material's name; layers of one name are chosen together.

    Raises:
        UsageError: a name that no material has, or nothing is left to paint.
    """
    known = list(dict.fromkeys(layer.name for layer in layers))
    wanted = {_named(name, known) for name in materials} or set(known)
    left = wanted - {_named(name, known) for name in exclude}
    if not left:
        raise UsageError(
            "materials.none_left", "no material is left to paint", f"the mesh has: {', '.join(known)}; exclude fewer"
        )
    return tuple(replace(layer, painted=layer.name in left) for layer in layers)


def _named(name: str, known: list[str]) -> str:
    if name in known:
        return name
    alike = [k for k in known if k.casefold() == name.casefold()]
    if len(alike) != 1:
        raise UsageError("materials.unknown", f"there is no material '{name}'", f"the mesh has: {', '.join(known)}")
    return alike[0]


def with_some_uvs(mesh: Mesh) -> Mesh:
    """The middle of the texture for corners of unpainted layers that have no finite texture coordinates."""
    unpainted = np.array([not layer.painted for layer in mesh.layers])[mesh.face_layer]
    lost = (mesh.face_uvs < 0).any(1)
    if len(mesh.uvs):
        lost |= ~np.isfinite(mesh.corner_uvs).all((1, 2))
    lost &= unpainted
    if not lost.any():
        return mesh
    face_uvs = mesh.face_uvs.copy()
    face_uvs[lost] = len(mesh.uvs)
    return replace(mesh, uvs=np.concatenate([mesh.uvs, [[0.5, 0.5]]]), face_uvs=face_uvs)
