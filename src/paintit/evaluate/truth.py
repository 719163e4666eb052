"""How far a painted mesh is from what it should be, where that is known: another set of maps for the same mesh."""

from __future__ import annotations

from paintit.color import encode_srgb, lab
from paintit.errors import PaintitError
from paintit.evaluate.color_difference import ciede2000
from paintit.evaluate.protocol import Protocol, surface
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

#: Chroma of a truth below which a ratio of saturations says nothing: greys.
_GREY = 10.0
#: Share of covered pixels that two files of the same mesh agree on at least.
_SAME = 0.97


def truth_scores(
    mesh: Mesh, maps: TextureMaps, truth: TextureMaps, protocol: Protocol, truth_mesh: Mesh | None = None
) -> dict[str, float | None]:
    """Errors over the pixels of the protocol's views.

    - ``delta_e``: CIEDE2000 of the mean base colours; ``delta_e_pixels``: the mean over pixels, which also counts a
      pattern that lies elsewhere.
    - ``roughness_error``, ``metallic_error``: absolute difference of the means, in [0, 1].
    - ``saturation_ratio``: mean chroma over the truth's; 1 is right; None for a grey truth.
    - ``relighting``: mean absolute difference of sRGB-coded pictures under the held-out light, in [0, 1].

    Args:
        truth_mesh: the same shape, where the truth has texture coordinates of its own.

    Raises:
        PaintitError: ``truth_mesh`` is another shape.
    """
    made = surface(mesh, maps, protocol, relit=True)
    true = surface(truth_mesh or mesh, truth, protocol, relit=True)
    mask = made.gbuffer.mask & true.gbuffer.mask
    shared = float(mask.sum() / (made.gbuffer.mask | true.gbuffer.mask).sum())
    if shared < _SAME:
        raise PaintitError(
            "evaluate.truth", f"the truth is another shape: {shared:.0%} of the pixels agree",
            "give the same mesh, painted as it should be",
        )  # fmt: skip
    made_color, true_color = made.base_color[mask], true.base_color[mask]
    made_lab, true_lab = lab(made_color), lab(true_color)
    made_chroma, true_chroma = (float(x[..., 1:].norm(dim=-1).mean()) for x in (made_lab, true_lab))
    relit = encode_srgb(made.shaded[mask]) - encode_srgb(true.shaded[mask])
    return {
        "delta_e": float(ciede2000(lab(made_color.mean(0)), lab(true_color.mean(0)))),
        "delta_e_pixels": float(ciede2000(made_lab, true_lab).mean()),
        "roughness_error": abs(float(made.roughness[mask].mean() - true.roughness[mask].mean())),
        "metallic_error": abs(float(made.metallic[mask].mean() - true.metallic[mask].mean())),
        "saturation_ratio": made_chroma / true_chroma if true_chroma > _GREY else None,
        "relighting": float(relit.abs().mean()),
    }
