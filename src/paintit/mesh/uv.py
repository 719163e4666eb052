"""Texture coordinates: judge them, make them, map texels to faces, fill what no face covers."""

from paintit.mesh.coverage import TexelMap, fill_gutters, nearest_covered, rasterize_uv
from paintit.mesh.quality import UVQuality, check
from paintit.mesh.unwrap import unwrap

__all__ = ["TexelMap", "UVQuality", "check", "fill_gutters", "nearest_covered", "rasterize_uv", "unwrap"]
