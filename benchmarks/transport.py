"""What an asset does to its own light, told apart from what the split sum does to it: by Mitsuba, judged by Cycles.

    python -m benchmarks.transport --mesh flight_helmet

Mitsuba renders the asset with each point alone under the whole light, with shadows, and with light from surface to
surface (``tests/judges/transport.py``). What it has between the first and another is laid over our picture, pixel by
pixel; PSNR in dB against Cycles, one for each view, of sRGB-coded pixels inside the silhouette. Prints the rows of the
table in docs/design/viewers.md; the sheet shows the view that is worst.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.viewers import MESHES, OUT, cells, difference, over_grey, sheet
from tests.judges.scene import Pixels, Scene, psnr
from tests.judges.transport import transport, with_transport
from tests.judges.viewers import cycles


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", default="flight_helmet", help="a name in assets/meshes, or a .glb with PBR maps")
    parser.add_argument("--size", type=int, default=128, help="pixels along each side (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=128, help="for each pixel (default: %(default)s)")
    parser.add_argument("--sheet", type=Path, default=OUT / "transport.jpg")
    given = parser.parse_args()
    path = Path(given.mesh) if given.mesh.endswith(".glb") else MESHES / f"{given.mesh}.glb"
    scene = Scene(path, size=given.size)
    alone = replace(scene, unoccluded=True)
    truth, light = cycles(scene, given.samples), transport(scene, given.samples)
    ours = alone.ours()

    def over(name: str) -> list[Pixels]:
        return [with_transport(image, view.alone, getattr(view, name)) for image, view in zip(ours, light, strict=True)]

    shown = {
        "ours, no occlusion": ours,
        "its occlusion texture": scene.ours(),
        "Mitsuba's shadows": over("shadowed"),
        "and light between": over("whole"),
    }
    figures = {name: list(map(psnr, images, truth)) for name, images in shown.items()}
    for name, figure in figures.items():
        print(f"| {name} | {cells(figure)} |")
    print(f"| nothing, against Cycles without shadows | {cells(list(map(psnr, ours, cycles(alone, given.samples))))} |")
    worst = int(np.argmin(figures["ours, no occlusion"]))
    tiles = [over_grey(truth[worst]), *(over_grey(images[worst]) for images in shown.values())]
    differences = map(partial(difference, truth[worst]), (truth[worst], *(images[worst] for images in shown.values())))
    strip = np.concatenate([np.concatenate(tiles, 1), np.concatenate(list(differences), 1)], 0)
    sheet({f"{path.stem}, below: difference from Cycles": strip}, ["Cycles", *shown], given.sheet)


if __name__ == "__main__":
    main()
