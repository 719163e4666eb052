"""How far noise that lies on the screen agrees between near views, by resolution, without any prior (docs/analyze.md).

    python benchmarks/screen_noise.py assets/meshes/spot/spot.obj

Five views within 2 degrees; the same epsilon of each view is carried back to a base colour map of 512 texels.
"""

from __future__ import annotations

import statistics
import sys
from pathlib import Path

from paintit.analyze.agreement import agreement
from paintit.analyze.coherence import NearViews
from paintit.config import LightConfig, PaintConfig, TextureConfig, ViewConfig
from paintit.guidance.exact import ExactPrior
from paintit.mesh.read import read_mesh
from paintit.paint.painter import Painter

SIZES = (32, 64, 128, 256, 512)
SEEDS = (0, 1, 2)


def main(path: Path) -> None:
    mesh = read_mesh(path)
    for size in SIZES:
        found = []
        for seed in SEEDS:
            config = PaintConfig(
                texture=TextureConfig(kind="pixels", size=512),
                views=ViewConfig(size=size),
                light=LightConfig(rotation=0.0),
                seed=seed,
            )
            views = NearViews(Painter(mesh, "-", config, ExactPrior()), 5, 2.0, "stack")
            found.append(agreement(views.control("noise", views.gradients(0.5, 1.0))))
        ratios = [statistics.fmean(place) for place in zip(*(one.ratios for one in found), strict=True)]
        print(
            f"{size:4} pixels: cosine {statistics.fmean(one.cosine for one in found):.2f}, "
            f"effective rank {statistics.fmean(one.effective_rank for one in found):.2f}, "
            f"ratios {', '.join(f'{ratio:.1f}' for ratio in ratios)}"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
