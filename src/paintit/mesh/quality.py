"""Can the texture coordinates be painted on? Measured per layer, decided with a reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from paintit.mesh.coverage import fragments
from paintit.mesh.mesh import Floats, Ints, Mesh, remembered
from paintit.mesh.normals import face_normals
from paintit.mesh.weld import components, edge_pairs, row_ids

MAX_DISTANT_OVERLAP = 0.10
"""Share of covered texels that two distant, unmirrored places may share before the UVs are given up."""
MAX_FLAT_AREA = 0.05
"""Share of the surface that may have no area in the texture."""
MIN_COVERAGE = 0.001
"""Share of the texture that a layer must cover; low, because several layers may share one atlas."""
MAX_REPEATS = 8.0
"""UV area, in whole textures, above which the overlap need not be measured."""
MAX_UV = 1e6
"""Texture coordinates beyond this are damage: float32 does not resolve texels there."""
MAX_STRETCH, MAX_STRETCHES = 64.0, 50_000.0
"""Repeats of the texture that one triangle, and that all together, may stretch over. A sliver has next to no area, and
yet every row of texels that it crosses is looked at."""
NEAR = 0.02
"""Places closer than this share of the mesh's extent are not distant."""


@dataclass(frozen=True)
class UVQuality:
    """What the texture coordinates of a mesh, or of one layer, are like.

    Attributes:
        has_uvs: every face has finite texture coordinates.
        islands: connected pieces of the atlas.
        overlap: UV area over covered area; 1 without overlap.
        distant_overlap: share of covered texels that two distant places share which are not mirror images.
        mirrored_overlap: share of covered texels that two mirror-image places share.
        coverage: share of the texture that is covered, mean over layers.
        zero_area_faces: faces without area in the texture.
        flat_area: share of the surface area on such faces.
        outside_unit: share of face corners outside [0, 1].
        mirrored_share: share of the UV area on faces that show the texture mirrored.
        texel_density: texels along one unit of length at ``resolution``, median over the surface.
        density_spread: ratio of the 95th to the 5th percentile of it.
        resolution: texels along each side of a layer that these were measured at.
        paintable: whether ``unwrap="auto"`` keeps these texture coordinates.
        reason: one sentence why, or why not.
        layers: the same for each painted layer alone; empty inside.
    """

    has_uvs: bool
    islands: int
    overlap: float
    distant_overlap: float
    mirrored_overlap: float
    coverage: float
    zero_area_faces: int
    flat_area: float
    outside_unit: float
    mirrored_share: float
    texel_density: float
    density_spread: float
    resolution: int
    paintable: bool
    reason: str
    layers: tuple[UVQuality, ...] = ()


def check(mesh: Mesh, resolution: int = 512) -> UVQuality:
    """Measure the texture coordinates.

    A corner without texture coordinates has ``face_uvs`` -1. A glTF primitive that several nodes show counts once,
    since its copies cannot be told apart in the texture. Layers that are not painted are not judged.

    Args:
        mesh: any mesh, with or without texture coordinates.
        resolution: texels along each side at which overlap and coverage are counted.
    """
    once = first_instances(mesh)
    judged = [k for k, layer in enumerate(mesh.layers) if layer.painted]
    measured = [_check_layer(mesh, np.flatnonzero((mesh.face_layer == k) & once), resolution) for k in judged]
    if len(measured) == 1:
        only = measured[0]
        return UVQuality(**{**{f: getattr(only, f) for f in _FIELDS}, "layers": (only,)})
    bad = [(mesh.layers[k].name, q) for k, q in zip(judged, measured, strict=True) if not q.paintable]
    area = np.array([q.overlap * q.coverage for q in measured])
    covered = np.array([q.coverage for q in measured])
    total, total_covered = max(float(area.sum()), 1e-12), max(float(covered.sum()), 1e-12)
    return UVQuality(
        has_uvs=all(q.has_uvs for q in measured),
        islands=sum(q.islands for q in measured),
        overlap=total / total_covered,
        distant_overlap=float(sum(q.distant_overlap * q.coverage for q in measured)) / total_covered,
        mirrored_overlap=float(sum(q.mirrored_overlap * q.coverage for q in measured)) / total_covered,
        coverage=float(covered.mean()),
        zero_area_faces=sum(q.zero_area_faces for q in measured),
        flat_area=max(q.flat_area for q in measured),
        outside_unit=float(np.mean([q.outside_unit for q in measured])),
        mirrored_share=float((area * [q.mirrored_share for q in measured]).sum()) / total,
        texel_density=float(np.median([q.texel_density for q in measured])),
        density_spread=max(q.density_spread for q in measured),
        resolution=resolution,
        paintable=not bad,
        reason=f"material '{bad[0][0]}': {bad[0][1].reason}" if bad else "every layer can be painted on",
        layers=tuple(measured),
    )


_FIELDS = [name for name in UVQuality.__dataclass_fields__ if name != "layers"]


def first_instances(mesh: Mesh) -> NDArray[np.bool_]:
    """(f,) True except on faces of a glTF primitive that an earlier part already shows."""
    keep, seen = np.ones(len(mesh.faces), bool), set()
    for part in mesh.parts:
        if part.primitive is not None:
            if part.primitive in seen:
                keep[part.faces[0] : part.faces[1]] = False
            seen.add(part.primitive)
    return keep


@remembered
def islands(mesh: Mesh) -> Ints:
    """(f,) atlas island of each face."""
    return island_labels(mesh.corner_uvs)[0]


def island_labels(corner_uvs: Floats) -> tuple[Ints, int]:
    """(f,) atlas island of each face, and their number. Faces are joined over edges that are one in the texture."""
    ids, _ = row_ids(corner_uvs.reshape(-1, 2))
    pairs = edge_pairs(ids.reshape(-1, 3), both_ways=True) // 3
    return components(pairs[:, 0], pairs[:, 1], len(corner_uvs))


def _unpaintable(reason: str, resolution: int, faces: int = 0) -> UVQuality:
    return UVQuality(False, 0, 0.0, 0.0, 0.0, 0.0, faces, 1.0, 0.0, 0.0, 0.0, 0.0, resolution, False, reason)


def _check_layer(mesh: Mesh, faces: Ints, resolution: int) -> UVQuality:
    missing = (mesh.face_uvs[faces] < 0).any(1)
    if missing.all():
        return _unpaintable("there are no texture coordinates", resolution)
    if missing.any():
        return _unpaintable(f"{int(missing.sum())} of {len(faces)} faces have no texture coordinates", resolution)
    uv = mesh.corner_uvs[faces]
    if not np.isfinite(uv).all():
        return _unpaintable("some texture coordinates are not finite", resolution)
    if np.abs(uv).max() > MAX_UV:
        return _unpaintable(f"some texture coordinates are as large as {np.abs(uv).max():.3g}", resolution)
    stretch = np.ptp(uv, axis=1).max(1)
    if stretch.max() > MAX_STRETCH or stretch.sum() > MAX_STRETCHES:
        return _unpaintable(f"a triangle stretches over {stretch.max():.3g} repeats of the texture", resolution)
    signed = _signed_areas(uv)
    area = face_normals(mesh.vertices, mesh.faces[faces])[1]
    size = np.abs(signed)
    flat = size < 1e-12
    flat_area = float(area[flat].sum() / max(area.sum(), 1e-300))
    total = float(size.sum())
    if total <= MAX_REPEATS:
        coverage, distant, mirrored, fragment_share = _overlap(mesh, faces, uv, resolution)
    else:
        coverage, distant, mirrored, fragment_share = 1.0, 1.0, 0.0, total
    real = (area > 0) & ~flat
    density = np.sqrt(size[real]) / np.sqrt(area[real]) * resolution  # two roots: the quotient of areas may overflow
    low, middle, high = np.percentile(density, [5, 50, 95]) if len(density) else (0.0, 0.0, 0.0)
    paintable, reason = _verdict(flat_area, coverage, distant, mirrored, total)
    return UVQuality(
        has_uvs=True,
        islands=island_labels(uv)[1],
        overlap=fragment_share,
        distant_overlap=distant,
        mirrored_overlap=mirrored,
        coverage=coverage,
        zero_area_faces=int(flat.sum()),
        flat_area=flat_area,
        outside_unit=float(((uv < 0) | (uv > 1)).any(-1).mean()),
        mirrored_share=float(size[signed > 0].sum() / max(total, 1e-300)),
        texel_density=float(middle),
        density_spread=float(high / low) if low > 0 else 0.0,
        resolution=resolution,
        paintable=paintable,
        reason=reason,
    )


def _verdict(flat_area: float, coverage: float, distant: float, mirrored: float, total: float) -> tuple[bool, str]:
    if flat_area > MAX_FLAT_AREA:
        return False, f"{flat_area:.0%} of the surface has no area in the texture"
    if total > MAX_REPEATS:
        return False, f"the texture repeats: the surface covers it {total:.1f} times"
    if distant > MAX_DISTANT_OVERLAP:
        return False, f"distant places share {distant:.0%} of the covered texels"
    if coverage < MIN_COVERAGE:
        return False, f"the surface covers only {coverage:.2%} of the texture"
    if mirrored > 0.001:
        return True, f"mirrored halves share {mirrored:.1%} of the covered texels"
    if distant > 0.001:
        return True, f"distant places share {distant:.1%} of the covered texels, which is little"
    return True, "the texture coordinates can be painted on"


def _signed_areas(uv: Floats) -> Floats:
    """(f,) area in the texture; positive where the texture appears mirrored (v runs downward)."""
    d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / 2


def _overlap(mesh: Mesh, faces: Ints, uv: Floats, resolution: int) -> tuple[float, float, float, float]:
    """Coverage, shares of it under distant and under mirrored overlap, mean number of faces per covered texel."""
    owner = np.full(resolution * resolution, -1, np.int64)
    place = np.zeros((resolution * resolution, 3))
    corners = mesh.vertices[mesh.faces[faces]]
    corners = (corners - corners.reshape(-1, 3).mean(0)) / max(mesh.extent, 1e-300)
    hits, texels, one, other, flipped = 0, [], [], [], []
    handed = np.sign(_signed_areas(uv))
    for part in fragments(uv, resolution):
        point = (corners[part.face] * part.barycentric[..., None]).sum(1)
        texel, first = np.unique(part.texel, return_index=True)
        new = owner[texel] < 0
        owner[texel[new]], place[texel[new]] = part.face[first[new]], point[first[new]]
        again = part.inner & (owner[part.texel] != part.face)
        hits += int(part.inner.sum())
        texels.append(part.texel[again])
        one.append(place[part.texel[again]])
        other.append(point[again])
        flipped.append(handed[part.face[again]] != handed[owner[part.texel[again]]])
    covered = int((owner >= 0).sum())
    if not covered:
        return 0.0, 0.0, 0.0, 1.0
    texel, p, q = (np.concatenate(x) for x in (texels, one, other))
    far = np.linalg.norm(p - q, axis=1) > NEAR
    # A mirrored half shows the texture the other way round; a moved copy of the same part does not.
    reflected = np.zeros(int(far.sum()), bool)
    turned = np.concatenate(flipped)[far]
    reflected[turned] = _mirror_images(p[far][turned], q[far][turned])
    distant = np.zeros(resolution * resolution, bool)
    distant[texel[far][~reflected]] = True
    mirrored = np.zeros_like(distant)
    mirrored[texel[far][reflected]] = True
    return (
        covered / resolution**2,
        float(distant.sum() / covered),
        float((mirrored & ~distant).sum() / covered),
        max(hits / covered, 1.0),
    )


def _mirror_images(p: Floats, q: Floats) -> NDArray[np.bool_]:
    """(n,) whether p and q are reflections in one of the (at most three) planes that most pairs agree on."""
    found = np.zeros(len(p), bool)
    difference = q - p
    length = np.linalg.norm(difference, axis=1, keepdims=True)
    normal = difference / np.maximum(length, 1e-12)
    for _ in range(3):
        left = np.flatnonzero(~found)
        if len(left) < 0.01 * len(p) or not len(left):
            break
        # The plane of one sample pair after another; keep the one with most followers.
        trial = left[np.linspace(0, len(left) - 1, min(len(left), 24)).astype(np.int64)]
        best = np.zeros(len(left), bool)
        for t in trial:
            offset = float(normal[t] @ (p[t] + q[t])) / 2
            image = q[left] - 2 * ((q[left] @ normal[t]) - offset)[:, None] * normal[t]
            agree = np.linalg.norm(image - p[left], axis=1) < NEAR
            best = agree if agree.sum() > best.sum() else best
        if best.sum() < 0.05 * len(p):
            break
        found[left[best]] = True
    return found
