"""Own the loop: the painter is an iterator of records, and its maps can be had at any step.

python examples/03_own_loop.py
"""

import dataclasses

import paintit
from paintit.paint.painter import Painter

config = dataclasses.replace(paintit.preset("pocket"), seed=1)
painter = Painter(paintit.load_mesh("assets/meshes/wingnut.stl"), "a rusty steel wing nut", config)
for step in painter:
    if step.index % 20 == 0:
        maps = painter.maps()  # base_color (layers, h, w, 3) linear, roughness, metallic, normal
        print(f"step {step.index}: mean metalness {maps.metallic.mean():.2f}, {step.seconds:.2f} s")
