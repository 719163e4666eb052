"""The project's own feature network: a small convolutional classifier that names the material in a picture.

It ships in the package, so that distances between sets of pictures can be had without a download. ``docs/evaluate.md``
says how it was trained and how often it is right; ``training/classifier`` trains it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import torch.nn.functional as F
from torch import Tensor, nn

#: Pixels along each side of the pictures that it reads.
SIDE = 64
#: Length of its feature vector.
FEATURES = 128


class ClassifierNet(nn.Module):
    """Pictures (n, 3, 64, 64), sRGB-coded in [0, 1] -> features (n, 128), and those -> logits (n, classes).

    Features are means over the picture, so they say what a surface looks like and hardly where.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()

        def block(given: int, out: int, stride: int) -> nn.Sequential:
            convolution = nn.Conv2d(given, out, 3, stride=stride, padding=1, bias=False)
            return nn.Sequential(convolution, nn.BatchNorm2d(out), nn.ReLU())

        self.trunk = nn.Sequential(
            block(12, 48, 1),
            block(48, 64, 2),
            block(64, 96, 1),
            block(96, 96, 2),
            block(96, FEATURES, 1),
            block(FEATURES, FEATURES, 1),
        )
        self.head = nn.Linear(FEATURES, classes)

    def features(self, images: Tensor) -> Tensor:
        return self.trunk(F.pixel_unshuffle(images * 2 - 1, 2)).mean((2, 3))

    def forward(self, images: Tensor) -> Tensor:
        return self.head(self.features(images))


@dataclass(frozen=True)
class Classifier:
    """The trained network.

    Attributes:
        net: ready to be asked, float32 on the CPU.
        classes: names in the order of the logits.
        accuracy: share of renders of shapes it had not seen that it names right.
    """

    net: ClassifierNet
    classes: tuple[str, ...]
    accuracy: float


@lru_cache(maxsize=1)
def load_classifier() -> Classifier:
    """The network in the package; its weights are kept in half precision."""
    from safetensors import safe_open

    with (
        resources.as_file(resources.files("paintit.evaluate") / "classifier.safetensors") as path,
        safe_open(str(path), "pt") as file,
    ):
        metadata = file.metadata()
        state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    classes = tuple(json.loads(metadata["classes"]))
    net = ClassifierNet(len(classes))
    net.load_state_dict({name: value.float() if value.is_floating_point() else value for name, value in state.items()})
    return Classifier(net.eval().requires_grad_(False), classes, float(metadata["accuracy"]))
