"""What is put on top of a prior, LoRAs and a reference picture: what was asked for, and where it is. No torch."""

from __future__ import annotations

import hashlib
import logging
import posixpath
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from PIL import Image, ImageOps, UnidentifiedImageError
from safetensors import SafetensorError, safe_open

from paintit.errors import PriorError
from paintit.guidance import hub, remote
from paintit.guidance.families import FAMILIES, Family, supported
from paintit.guidance.known import known_prior
from paintit.guidance.loading import Loading
from paintit.guidance.parts import PICKLES
from paintit.picture import opened
from paintit.scaled import scaled

log = logging.getLogger(__name__)

#: What diffusers calls a LoRA: taken where a folder holds several files.
USUAL = "pytorch_lora_weights.safetensors"
#: (inside the adapter's folder, seen from it) where the encoder of its pictures is. Those called vit-h share a smaller
#: one, which is published beside the adapters of Stable Diffusion 1.5.
ENCODER, SMALLER = "image_encoder", "../models/image_encoder"

Names = Callable[[str, Callable[[str], bool]], Sequence[str]]
"""(path of the weights, whether a path is there) -> further paths that are needed with it."""


@dataclass(frozen=True)
class Weights:
    """One file of weights on this machine, and what belongs to it."""

    file: Path
    revision: str
    """Commit; or, of a file that came from no hub, its SHA-256."""
    beside: tuple[Path, ...] = ()


def with_adapter(id: str, loading: Loading) -> Loading:
    """``loading`` with the IP-Adapter that belongs to the prior ``id``, where a picture is given and no adapter."""
    known = known_prior(id)
    if not known or not loading.reference or loading.adapter:
        return loading
    return replace(loading, adapter=known.adapter)


def check(id: str, loading: Loading, family: Family | None) -> None:
    """Refuse before anything is loaded what is asked for and cannot be had.

    Args:
        family: of the prior ``id``; None where it is none of diffusers'.

    Raises:
        PriorError: the family takes none, an extra is not installed, or there are no such files. What may be
            downloaded is not asked for.
        UsageError: a scale that is none.
    """
    if loading.lora and family is None:
        raise PriorError("prior.lora", f"'{id}' takes no LoRA", f"leave --lora out, or choose one of {supported()}")
    if loading.lora:
        hub.require_extra("a LoRA", ["peft"])
    if loading.reference and not (family and family.pictures):
        able = " or ".join(each.about for each in FAMILIES.values() if each.pictures)
        raise PriorError(
            "prior.adapter", f"'{id}' takes no reference picture", f"leave --reference out, or choose one of {able}"
        )
    asked = [(scaled(text, "guidance.lora")[0], find_lora) for text in loading.lora]
    if loading.reference:
        if not loading.adapter:
            raise PriorError(
                "prior.adapter",
                f"no IP-Adapter is known for '{id}'",
                "name one that was made for its architecture; for Stable Diffusion 1.5 "
                "--guidance.adapter h94/IP-Adapter/models/ip-adapter_sd15.safetensors",
            )
        read_picture(scaled(loading.reference, "guidance.reference")[0], loading.megapixels)
        asked.append((loading.adapter, find_adapter))
    for source, find in asked:
        try:
            find(source, False)
        except PriorError as error:
            if error.code != "prior.not_cached" or not loading.allow_download:
                raise


def read_picture(name: str, megapixels: int) -> tuple[Image.Image, str]:
    """The picture in the file ``name``, RGB, upright, on white where it is transparent; and its SHA-256.

    Args:
        megapixels: the most that it may have.

    Raises:
        PriorError: there is no such file, it is no PNG, JPEG or WebP, it is broken or too large.
    """
    hint = "give a PNG, JPEG or WebP picture"
    try:
        data = Path(name).expanduser().read_bytes()
        image = opened(data)
        found = -(-image.width * image.height // 10**6)
        if found > megapixels:
            raise PriorError(
                "prior.picture",
                f"the reference '{name}' has {found} megapixels, more than the limit of {megapixels}",
                f"make it smaller, or if you trust it, add --limits.image-megapixels {found}",
            )
        image = ImageOps.exif_transpose(image)
        if image.mode.startswith("I"):  # grey of 16 bits
            image = image.convert("I").point(lambda value: value / 257)
        upright = image.convert("RGBA")
    except (OSError, SyntaxError, ValueError) as error:
        unknown = isinstance(error, UnidentifiedImageError)
        reason = "it is none of these" if unknown else getattr(error, "strerror", None) or str(error)
        raise PriorError("prior.picture", f"the reference '{name}' cannot be read: {reason.lower()}", hint) from None
    white = Image.new("RGBA", upright.size, "white")
    return Image.alpha_composite(white, upright).convert("RGB"), hashlib.sha256(data).hexdigest()


def on_record(kind: str, source: str, scale: float, revision: str) -> str:
    """One addition in words, for ``run.json``, which holds no path of this machine."""
    name = Path(source).name if Path(source).expanduser().exists() else source
    return f"{kind} {scale:g}: {name} ({revision})"


def find_lora(source: str, allow_download: bool) -> Weights:
    """The file of the LoRA ``source``: a file, a folder with one, a hub id, or ``OWNER/NAME/FILE``.

    Raises:
        PriorError: there is none, or several; or it is pickled, broken or no LoRA; or it cannot be had.
    """
    found = _find(source, allow_download, lambda file, has: ())
    names = list(shapes(found.file, source))
    strange = next((name for name in names if not belongs(name) and not name.endswith("alpha")), "no weights")
    if strange in names or not names:
        raise PriorError(
            "prior.lora", f"'{source}' is no LoRA: it holds {strange}", "give the file that a LoRA training saved"
        )
    return found


def belongs(name: str) -> bool:
    """Whether this is an array of a LoRA; a DoRA's magnitudes are not: diffusers would leave them out, wrongly."""
    return "lora" in name and "dora_scale" not in name


def shapes(file: Path, source: str) -> dict[str, tuple[int, ...]]:
    """Name -> shape of the arrays in a safetensors file, from its header.

    Raises:
        PriorError: it is broken.
    """
    try:
        with safe_open(file, "numpy") as opened_file:
            names = opened_file.keys()
            return {name: tuple(opened_file.get_slice(name).get_shape()) for name in names}
    except (SafetensorError, OSError) as error:
        raise PriorError("prior.load", f"'{source}' cannot be read: {error}", "fetch it again") from error


def find_adapter(source: str, allow_download: bool) -> Weights:
    """The file of the IP-Adapter ``source``, and the configuration and weights of its image encoder.

    Raises:
        PriorError: there is none, or several; or it is pickled; or it cannot be had; or there is no image encoder.
    """

    def beside(file: str, has: Callable[[str], bool]) -> Sequence[str]:
        places = (SMALLER, ENCODER) if "vit-h" in posixpath.basename(file) else (ENCODER,)
        folders = [posixpath.normpath(posixpath.join(posixpath.dirname(file), place)) for place in places]
        for folder in folders:
            needed = (f"{folder}/config.json", f"{folder}/model.safetensors")
            if all(map(has, needed)):
                return needed
        raise PriorError(
            "prior.weights",
            f"the IP-Adapter '{source}' has no {folders[-1]}/config.json and model.safetensors beside it",
            "put the image encoder that it was trained with there",
        )

    return _find(source, allow_download, beside)


def _find(source: str, allow_download: bool, beside: Names) -> Weights:
    path = Path(source).expanduser()
    if path.is_dir():
        return _local(path, _choice([child.name for child in path.iterdir()], source), beside)
    if path.is_file():
        return _local(path.parent, _choice([path.name], source), beside)
    owner, name, inner = (*source.split("/", 2), "", "")[:3]
    is_path = path.is_absolute() or source.startswith((".", "~")) or "\\" in source
    if is_path or not name or (not inner and name.endswith(".safetensors")):
        raise PriorError("prior.missing", f"there is no file or folder '{source}'", "check the path")
    return _of_hub(f"{owner}/{name}", inner, source, allow_download, beside)


def _local(folder: Path, name: str, beside: Names) -> Weights:
    with (folder / name).open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    needed = beside(name, lambda path: (folder / path).is_file())
    return Weights(folder / name, digest, tuple(folder / path for path in needed))


def _of_hub(id: str, inner: str, source: str, allow_download: bool, beside: Names) -> Weights:
    """From the cache where all of it is there."""

    def choose(names: Collection[str]) -> tuple[str, ...]:
        wanted = [name for name in names if name == inner] if inner else [name for name in names if "/" not in name]
        file = _choice(wanted, source)
        return file, *beside(file, lambda path: path in names)

    folder = remote.cached_folder(id)
    if folder:
        try:
            names = choose([path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()])
            return Weights(folder / names[0], folder.name, tuple(folder / name for name in names[1:]))
        except PriorError as error:
            if error.code != "prior.weights":
                raise
    if not allow_download:
        raise PriorError(
            "prior.not_cached",
            f"'{source}' is neither a file or folder here nor in the cache, and nothing is downloaded unasked",
            "check the path, or add --allow-download (allow_download=True in Python)",
        )
    listing = remote.ask(id)
    names = choose(listing.sizes)
    megabytes = sum(listing.sizes[name] for name in names) / 1e6
    log.warning("downloading %.1f MB of %s; licence: %s", megabytes, id, listing.licence or "not stated; read its page")
    folder = remote.fetch(id, "", names)
    return Weights(folder / names[0], folder.name, tuple(folder / name for name in names[1:]))


def _choice(names: Collection[str], source: str) -> str:
    """The one file of weights among ``names``."""
    files = sorted(name for name in names if name.endswith(".safetensors"))
    if USUAL in files:
        return USUAL
    if len(files) > 1:
        listed = ", ".join(files[:5]) + (", ..." if len(files) > 5 else "")
        raise PriorError("prior.several", f"'{source}' holds {len(files)} files of weights: {listed}", "name one")
    if files:
        return files[0]
    if any(name.endswith(PICKLES) for name in names):
        raise PriorError(
            "prior.pickle",
            f"'{source}' is pickled, which can run code when read",
            "choose a safetensors file, or convert it with diffusers",
        )
    raise PriorError("prior.weights", f"'{source}' has no safetensors file of weights", "check the name")
