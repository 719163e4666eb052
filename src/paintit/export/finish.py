"""The last touch on painted maps: texels that no camera sees, UV seams, and the gutters between islands."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from paintit.export.image import check_layers
from paintit.export.seam_finish import close_seams
from paintit.mesh.mesh import Mesh
from paintit.mesh.uv import fill_gutters, rasterize_uv
from paintit.render.geometry import Geometry
from paintit.render.texels import seen, texel_points
from paintit.texture.maps import TextureMaps

#: Seen texels that an unseen one is blended from.
NEIGHBOURS = 16
#: Support below which a texel is taken from its neighbours, and from which on it keeps what was painted; between them
#: the two blend. As shares of the median over the texels that a camera sees.
SUPPORT = (0.2, 0.5)
#: Side of the largest grid of texels whose visibility is asked with rays.
VISIBILITY_SIZE = 256


def finish(mesh: Mesh, maps: TextureMaps, support: torch.Tensor | None = None) -> TextureMaps:
    """Maps ready for a file, detached, on the CPU.

    Texels that no camera on a sphere around the mesh could see are filled from the seen ones nearest to them on the
    surface: the network is told nothing about them and leaves inverted values there. So are those that were next to no
    part of the painted views (``support``, (layers, h, w), from the painter): a small part that owns many texels. Then
    the two sides of each UV seam are brought together (:func:`paintit.export.seam_finish.close_seams`), and each texel
    outside the islands takes the nearest value inside or at a seam, so that mip levels do not bleed. Layers that are
    not painted come back as they are (they own no texels, see ``rasterize_uv``). Deterministic.
    """
    values = filled(mesh, maps, support)
    texels = rasterize_uv(mesh, maps.size[0])
    closed, own = close_seams(mesh, values, texels)
    return normalized(TextureMaps.unpacked(torch.from_numpy(fill_gutters(closed, own))))


def filled(mesh: Mesh, maps: TextureMaps, support: torch.Tensor | None = None) -> NDArray[np.float32]:
    """Packed maps (layers, h, w, 8) with unseen texels and gutters filled, seams as they are: :func:`finish`'s half."""
    check_layers(mesh, maps)
    packed = maps.packed().detach().to("cpu", torch.float32)
    height, width = maps.size
    if height != width:
        raise ValueError(f"maps must be square, not {height} x {width}")
    geometry = Geometry.from_mesh(mesh)
    covered, position, _ = (np.asarray(found) for found in texel_points(mesh, geometry, height))
    visible = visibility(mesh, geometry, height) & covered
    painted, keep = packed.numpy(), visible.astype(np.float32)
    if support is not None and visible.any():
        had = support.detach().cpu().numpy()
        low, high = (share * float(np.median(had[visible])) for share in SUPPORT)
        keep *= np.clip((had - low) / max(high - low, 1e-30), 0, 1)
    values = fill_unseen(painted, covered, keep == 1, position)
    return fill_gutters(values + keep[..., None] * (painted - values), covered)


def visibility(mesh: Mesh, geometry: Geometry, size: int) -> NDArray[np.bool_]:
    """(layers, size, size) whether a camera could see the texel; asked for at most ``VISIBILITY_SIZE`` texels a side.

    Hidden texels cost a ray for every camera, so large maps ask a coarser grid: each texel takes the answer of the
    nearest covered texel of that grid.
    """
    coarse = min(size, VISIBILITY_SIZE)
    visible = np.asarray(seen(mesh, geometry, coarse))
    if coarse == size:
        return visible
    covered = rasterize_uv(mesh, coarse).face >= 0
    filled = fill_gutters(visible[..., None].astype(np.float32), covered)[..., 0] > 0.5
    index = np.arange(size) * coarse // size
    return filled[:, index[:, None], index[None, :]]


def normalized(maps: TextureMaps) -> TextureMaps:
    """Unit normals again after blending; +Z where a blend cancelled out."""
    length = maps.normal.norm(dim=-1, keepdim=True)
    up = torch.tensor([0.0, 0.0, 1.0]).expand_as(maps.normal)
    normal = torch.where(length > 1e-6, maps.normal / length.clamp_min(1e-6), up)
    return TextureMaps(maps.base_color, maps.roughness, maps.metallic, normal)


def fill_unseen(
    values: NDArray[np.float32], covered: NDArray[np.bool_], visible: NDArray[np.bool_], position: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Covered texels that are not visible take a blend of the visible ones nearest in space.

    Neighbours come from the same layer; a layer without any visible texel takes the mean of all visible texels.

    Args:
        values: (layers, h, w, c).
        covered, visible: (layers, h, w).
        position: (layers, h, w, 3) place of each covered texel on the surface.

    Returns:
        (layers, h, w, c); visible texels and those outside the islands unchanged. Nothing is changed where nothing is
        visible at all.
    """
    out = values.copy()
    visible = visible & covered
    if not visible.any():
        return out
    mean = values[visible].astype(np.float64).mean(0).astype(np.float32)
    for layer in range(len(values)):
        hidden = covered[layer] & ~visible[layer]
        if not hidden.any():
            continue
        if not visible[layer].any():
            out[layer][hidden] = mean
            continue
        out[layer][hidden] = blend_nearest(
            position[layer][visible[layer]], values[layer][visible[layer]], position[layer][hidden]
        )
    return out


def blend_nearest(
    points: NDArray[np.float32], values: NDArray[np.float32], at: NDArray[np.float32], neighbours: int = NEIGHBOURS
) -> NDArray[np.float32]:
    """Inverse-squared-distance mean of the values at the nearest ``points`` (n, 3) to each of ``at`` (m, 3) -> (m, c).

    The weight falls to zero at the farthest neighbour (Shepard's local form, (R - d)^2 / (R d)^2), so the result is
    continuous as neighbours change; where all are equally far it is their plain mean.
    """
    from scipy.spatial import KDTree

    k = min(neighbours, len(points))
    distance, index = KDTree(points).query(at, k=k, workers=-1)
    distance, index = distance.reshape(len(at), k), index.reshape(len(at), k)
    near = np.maximum(distance, 1e-9)
    reach = near[:, -1:] * (1.0 + 1e-6)
    weight = ((reach - near) / (reach * near)) ** 2
    weight /= weight.sum(1, keepdims=True)
    return np.einsum("mk,mkc->mc", weight, values[index].astype(np.float64)).astype(np.float32)
