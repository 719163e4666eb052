"""All scores of some sets of painted meshes: what ``paintit evaluate`` prints, writes and shows."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from paintit.errors import PaintitError
from paintit.evaluate.distances import cmmd, fid, kid
from paintit.evaluate.features import Network
from paintit.evaluate.protocol import Protocol, as_images, pictures
from paintit.evaluate.scores import Scores, asset_scores, finite
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

#: Endings of files that are read as pictures.
PICTURES = (".png", ".jpg", ".jpeg", ".webp")


@dataclass(frozen=True)
class Painted:
    """A painted mesh that is measured, or that others are measured against."""

    name: str
    mesh: Mesh
    maps: TextureMaps
    prompt: str = ""


@dataclass(frozen=True)
class AssetScores:
    """One painted mesh: its set, its prompt where it is known, and its scores."""

    name: str
    set: str
    prompt: str
    scores: Scores


@dataclass(frozen=True)
class SetScores:
    """Painted meshes that are compared as one: means of their scores, and distances from the reference."""

    name: str
    assets: int
    pictures: int
    scores: Scores


@dataclass(frozen=True)
class Reference:
    """What sets are compared with.

    Attributes:
        features: (n, d) of its pictures; ``relit`` those under the held-out light, where they can be had.
    """

    name: str
    features: Tensor
    relit: Tensor | None = None


@dataclass(frozen=True)
class Evaluation:
    """Everything that was measured, and how."""

    network: str
    protocol: Protocol
    reference: str
    reference_pictures: int
    sets: tuple[SetScores, ...]
    assets: tuple[AssetScores, ...]
    notes: tuple[str, ...] = field(default=())


def evaluate(
    sets: Mapping[str, Sequence[Painted]],
    protocol: Protocol,
    network: Network,
    reference: Reference | None = None,
    truths: Mapping[str, Painted] | None = None,
    on_asset: Callable[[Painted], None] = lambda _: None,
) -> Evaluation:
    """Measure every asset of every set, and every set against the reference.

    Args:
        sets: name -> painted meshes.
        truths: name of an asset -> what it should look like.
        on_asset: called before each is measured.
    """
    assets: list[AssetScores] = []
    totals: list[SetScores] = []
    for name, members in sets.items():
        first, features, relit = len(assets), [], []
        for painted in members:
            on_asset(painted)
            truth = (truths or {}).get(painted.name)
            scores = asset_scores(
                painted.mesh, painted.maps, protocol, network,
                truth.maps if truth else None, truth.mesh if truth else None, painted.prompt,
            )  # fmt: skip
            assets.append(AssetScores(painted.name, name, painted.prompt, scores))
            if reference is not None:
                features.append(features_of(painted, protocol, network))
            if reference is not None and reference.relit is not None:
                relit.append(features_of(painted, protocol, network, relit=True))
        scores = _means([asset.scores for asset in assets[first:]])
        if reference is not None:
            scores |= distances(reference.features, torch.cat(features), network.name)
        if reference is not None and reference.relit is not None:
            scores |= distances(reference.relit, torch.cat(relit), network.name, "_relit")
        totals.append(SetScores(name, len(members), len(members) * protocol.views, finite(scores)))
    return Evaluation(
        network.name, protocol,
        reference.name if reference else "", len(reference.features) if reference else 0,
        tuple(totals), tuple(assets), _notes(totals, reference, network),
    )  # fmt: skip


def distances(real: Tensor, made: Tensor, network: str, ending: str = "") -> Scores:
    """FID and KID, and of a CLIP also CMMD; the names say which network and, by ``ending``, which light."""
    scores: Scores = {
        f"fid_{network}{ending}": fid(real, made),
        f"kid_{network}{ending}": kid(real, made),
    }
    if network.startswith("clip"):
        scores[f"cmmd_{network}{ending}"] = cmmd(real, made)
    return scores


def features_of(painted: Painted, protocol: Protocol, network: Network, *, relit: bool = False) -> Tensor:
    """(views, d) features of one painted mesh's pictures."""
    return network.features(as_images(pictures(painted.mesh, painted.maps, protocol, relit=relit)))


def reference_of_assets(name: str, assets: Sequence[Painted], protocol: Protocol, network: Network) -> Reference:
    """A reference that is rendered by the same protocol, under both lights."""
    shaded, relit = (
        torch.cat([features_of(each, protocol, network, relit=late) for each in assets]) for late in (False, True)
    )
    return Reference(name, shaded, relit)


def reference_of_pictures(folder: Path, network: Network) -> Reference:
    """A reference of the picture files in ``folder``, in the order of their names. They cannot be relit.

    Raises:
        PaintitError: there are fewer than two, or one cannot be read.
    """
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in PICTURES)
    if len(files) < 2:
        raise PaintitError(
            "evaluate.reference", f"there are {len(files)} pictures in {folder}",
            f"give a folder of at least two {', '.join(PICTURES)} files, or painted assets",
        )  # fmt: skip
    return Reference(str(folder), torch.cat([network.features(_picture(file)) for file in files]))


def _picture(file: Path) -> Tensor:
    """(1, 3, h, w) uint8."""
    try:
        with Image.open(file) as image:
            pixels = np.array(image.convert("RGB"))
    except (OSError, ValueError) as error:
        raise PaintitError(
            "evaluate.reference", f"{file} cannot be read as a picture", "remove it from the reference"
        ) from error
    return as_images(pixels[None])


def _means(rows: Sequence[Scores]) -> Scores:
    """The mean of each score over the rows that have it; None where none has."""
    names = dict.fromkeys(name for row in rows for name in row)
    found = {name: [v for row in rows if (v := row.get(name)) is not None] for name in names}
    return {name: statistics.fmean(values) if values else None for name, values in found.items()}


def _notes(totals: Sequence[SetScores], reference: Reference | None, network: Network) -> tuple[str, ...]:
    """What a reader of the figures has to know."""
    if reference is None:
        return ()
    fewest = min(len(reference.features), *(t.pictures for t in totals))
    notes: list[str] = []
    if fewest <= network.dimensions:
        notes.append(f"FID of {fewest} pictures in {network.dimensions} dimensions is far too large; trust KID")
    if len({t.pictures for t in totals}) > 1:
        notes.append("the sets differ in size, and FID with it; compare them by KID")
    return tuple(notes)
