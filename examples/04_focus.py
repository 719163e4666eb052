"""Spend half of the views on the face, as the paper does for people and animals (supp. A.2).

    python examples/04_focus.py

The centre and the radius are in the mesh's own units. The same from the command line:
    paintit paint assets/meshes/human.obj "a firefighter in uniform" --focus 0,1.6,0.05,0.18,face
"""

import dataclasses

import paintit
from paintit.config import FocusConfig

pocket = paintit.preset("pocket")
face = FocusConfig(center=(0.0, 1.6, 0.05), radius=0.18, name="face")
config = dataclasses.replace(pocket, views=dataclasses.replace(pocket.views, count=8, focus=(face,)))
result = paintit.paint("assets/meshes/human.obj", "a firefighter in uniform", config=config)
print(result.export("outputs/examples/firefighter.glb", overwrite=True))
