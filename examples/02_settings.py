"""Change settings, watch the steps, stop early.

    python examples/02_settings.py

Settings are frozen dataclasses; the command line and TOML files spell them the same way.
"""

import dataclasses
from pathlib import Path

import paintit
from paintit.paint.painter import Step

pocket = paintit.preset("pocket")
config = dataclasses.replace(
    pocket,
    texture=dataclasses.replace(pocket.texture, size=256),
    optim=dataclasses.replace(pocket.optim, steps=60),
    seed=3,
)


def watch(step: Step) -> bool:
    """Called after every step; False stops."""
    if step.index % 10 == 0:
        print(f"step {step.index}/{step.total}  t {step.t:.2f}  gradient norm {step.gradient_norm:.3f}")
    return step.index < 50


result = paintit.paint("assets/meshes/bob/bob.obj", "glossy red plastic", config=config, on_step=watch)
print(result.outcome)
picture = Path("outputs/examples/bob.png")
picture.parent.mkdir(parents=True, exist_ok=True)
result.preview(size=256).save(picture)
