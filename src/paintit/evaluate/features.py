"""Networks that turn pictures into features, by name. A score's name ends in the network's: ``fid_pocket``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from paintit.errors import UsageError
from paintit.evaluate.protocol import Protocol, as_images, pictures
from paintit.mesh.mesh import Mesh
from paintit.render.camera import Cameras
from paintit.settings import nearest
from paintit.texture.maps import TextureMaps

#: Pictures read at once.
BATCH = 32
#: Name -> what it is.
NETWORKS = {
    "pocket": "the project's own material classifier, 64 pixels; ships in the package",
    "inception": "Inception v3 as published for FID, 299 pixels",
    "clip": "CLIP ViT-B/32, 224 pixels: CLIP-FID, CLIP score",
    "clip-large": "CLIP ViT-L/14, 336 pixels: CMMD",
}


@dataclass(frozen=True)
class Network:
    """A feature network.

    Attributes:
        name: ends the names of scores made from it.
        dimensions: length of a feature vector.
        side: pixels along each side of what it looks at; pictures of another size are resized.
        read: (n, 3, side, side) float in [0, 1], sRGB-coded -> (n, dimensions).
        words: texts -> (n, dimensions) in the same space, where it reads text.
    """

    name: str
    dimensions: int
    side: int
    read: Callable[[Tensor], Tensor]
    words: Callable[[Sequence[str]], Tensor] | None = None

    @torch.no_grad()
    def features(self, images: Tensor) -> Tensor:
        """(n, 3, h, w) uint8 -> (n, dimensions) float32."""
        return torch.cat([self.read(self._resized(part)).float() for part in images.split(BATCH)])

    def _resized(self, images: Tensor) -> Tensor:
        """To ``side`` by an antialiased cubic filter: careless resizing moves FID (Parmar et al. 2022)."""
        images = images.float() / 255
        if images.shape[-2:] == (self.side, self.side):
            return images
        size = (self.side, self.side)
        return F.interpolate(images, size, mode="bicubic", antialias=True, align_corners=False).clamp(0, 1)


def load_network(name: str, weights: str = "", *, allow_download: bool = False) -> Network:
    """The network called ``name``.

    Args:
        weights: a file (inception) or folder (clip) that holds its weights; "" looks in the usual caches.
        allow_download: nothing is fetched without it.

    Raises:
        UsageError: the name is unknown.
        PaintitError: its weights are not on this machine, or its extra is not installed.
    """
    if name == "pocket":
        return _pocket()
    if name not in NETWORKS:
        near = nearest(name, NETWORKS)
        hint = f"did you mean '{near}'?" if near else f"choose one of {', '.join(NETWORKS)}"
        raise UsageError("evaluate.network", f"there is no feature network '{name}'", hint)
    from paintit.evaluate import pretrained

    if name == "inception":
        return pretrained.inception(weights, allow_download)
    return pretrained.clip(name, weights, allow_download)


def _pocket() -> Network:
    from paintit.evaluate.classifier import FEATURES, SIDE, load_classifier

    return Network("pocket", FEATURES, SIDE, load_classifier().net.features)


def view_features(
    mesh: Mesh,
    maps: TextureMaps,
    protocol: Protocol,
    network: Network,
    cameras: Cameras | None = None,
    *,
    relit: bool = False,
) -> Tensor:
    """(views, dimensions) features of the pictures that :func:`paintit.evaluate.protocol.pictures` makes."""
    return network.features(as_images(pictures(mesh, maps, protocol, cameras, relit=relit)))
