"""Paint a mesh by a sentence and write a GLB.

python examples/01_paint.py
"""

import paintit

mesh = paintit.load_mesh("assets/meshes/spot/spot.obj")
result = paintit.paint(mesh, "a brown and white dairy cow with short fur", seed=0)
print(result.export("outputs/examples/spot.glb", overwrite=True), result.outcome)
