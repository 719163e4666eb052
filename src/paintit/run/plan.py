"""``--dry-run``: everything that a paint would do, found out without painting or writing."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch

from paintit.config import PaintConfig
from paintit.control import Control
from paintit.device import choose_device
from paintit.errors import PriorError
from paintit.guidance import additions, hub
from paintit.guidance.economy import Beside, Budget, Choice, Economy
from paintit.guidance.families import FAMILIES
from paintit.guidance.known import known_prior
from paintit.guidance.load import controls_for, load_prior, on_this_machine, plan_memory
from paintit.guidance.loading import Loading
from paintit.guidance.losses import require, require_path
from paintit.guidance.prompt import Prompts
from paintit.guidance.sampling import require_geometry, sampling_prior
from paintit.guidance.schedule import with_scales
from paintit.mesh.mesh import Mesh
from paintit.paint.footprint import beside
from paintit.paint.views import focus_note, focus_regions
from paintit.render.light import load_environment
from paintit.run.folder import RunFolder
from paintit.run.paint import prepare
from paintit.run.request import Request, check

#: Errors of a prior that a dry run ends with; others, such as a missing download, it only tells.
_REFUSED = (
    "prior.unknown", "prior.missing", "prior.file", "prior.control", "prior.lora", "prior.adapter", "prior.picture",
    "prior.several",
)  # fmt: skip

#: Bytes that Python, torch, the pocket prior and the renderer take whatever the settings, and those for each face.
#: With a step's own (``paint.footprint``) the preset ``pocket`` is estimated at 926 MiB at 512 texels (measured on
#: Linux without a GPU: 880) and 1328 at 1024 (1250); with ``texture.upsample`` 1 at 796 MiB at 64 texels (785 to
#: 930), 1020 at 512 (1000), 2184 with six materials (2.2 GiB); a hash grid of 1024 texels at 4.4 GiB (4.2).
BASE, FACE = 780 << 20, 400


def plan(request: Request) -> dict[str, Any]:
    """The plan as plain data. Fails where the paint itself would fail early.

    Raises:
        PaintitError: as ``run.paint.prepare``.
    """
    if request.resume is not None:
        job = prepare(request)
        request = dataclasses.replace(request, config=job.painter.config)
        return _plan(request, job.folder, job.mesh, job.prompt) | {"resume_after_step": job.painter.step}
    found = check(request)
    return _plan(request, found.folder, found.mesh, found.prompt)


def _plan(request: Request, folder: RunFolder, mesh: Mesh, prompt: str) -> dict[str, Any]:
    config = request.config
    device, reason = choose_device(config.device)
    environment = load_environment(config.light.path, config.light.exposure)
    regions = [region.name for region in focus_regions(mesh, config.views)]
    focus = focus_note(mesh, config.views)
    prompts = Prompts.of(prompt, config, regions)
    files = [folder.asset, folder.textures, folder.record, folder.config, folder.log, folder.checkpoint]
    files += [folder.preview] if request.preview else []
    files += [folder.turntable] if request.turntable else []
    files += [folder.snapshots] if request.snapshot_every else []
    painted = [layer.name for layer in mesh.layers if layer.painted]
    projects = config.method == "projection"
    steps, count = (config.projection.views, 1) if projects else (config.optim.steps, config.views.count)
    prior, own_scale = _prior(request)
    step = beside(mesh, config, device)
    choice = _choice(request, step, device)
    known = known_prior(config.guidance.prior)
    economy = choice and (choice.economy.words or "nothing needs to be saved")
    if choice is None and known is not None and known.sources:
        economy = "chosen once the prior is on this machine; the memory above is without it"
    return {
        "mesh": mesh.source.path.name if mesh.source else "",
        "faces": len(mesh.faces),
        "layers": [layer.name for layer in mesh.layers],
        "painted": painted,
        "uvs": "kept from the file" if mesh.report.uv_origin == "file" else "made by unwrapping",
        "notes": [*mesh.report.notes, *([focus] if focus else [])],
        "prior": prior,
        "guidance": _guidance(config, own_scale),
        "light": environment.name,
        "prompts": list(prompts.distinct()),
        "method": config.method,
        "steps": steps,
        "views": f"{count} of {config.views.size} x {config.views.size} pixels",
        "textures": f"{len(painted)} x {config.texture.size} x {config.texture.size} texels",
        "device": str(device),
        "device_reason": reason,
        "seed": config.seed,
        "memory": choice.bytes if choice else BASE + FACE * len(mesh.faces) + step.peak,
        **({"economy": economy} if economy else {}),
        "run": str(folder.folder),
        "files": [str(path) for path in files],
    }


def _prior(request: Request) -> tuple[str, float | None]:
    """The prior in words, and its own guidance scale where that is known. A known large one is not loaded.

    Raises:
        PriorError: an unknown one, or one that cannot serve the loss or the method.
    """
    config, guidance = request.config, request.config.guidance
    known = known_prior(guidance.prior)
    if known is not None and known.sources:
        if config.method == "projection":
            require_geometry(known.name, bool(known.sees or guidance.control), "projection")
        else:
            require_path(known.name, FAMILIES[known.family].flow, guidance.loss)
        source = known.sources[0] if guidance.prior == known.name else guidance.prior
        text = f"{known.name}: {known.note} ({source}, {known.licence}, {known.size_mb / 1000:.1f} GB)"
        loading = additions.with_adapter(guidance.prior, Loading.of(config, allow_download=request.allow_download))
        additions.check(guidance.prior, loading, FAMILIES[known.family])
        text += "".join(f"; LoRA {lora}" for lora in guidance.lora)
        text += f"; reference {guidance.reference} by {loading.adapter}" if guidance.reference else ""
        for control in controls_for(guidance.prior, tuple(map(Control.parse, guidance.control))):
            text += f"; {control.kind} control {control.scale:g}: {control.model}"
        if on_this_machine(known, guidance.prior, guidance.revision):
            return text, known.guidance
        try:
            hub.require_extra(FAMILIES[known.family].about)
        except PriorError as error:
            return f"{text}; {error}", known.guidance
        what = "will be downloaded" if request.allow_download else "add --allow-download to fetch it"
        return f"{text}; not on this machine, {what}", known.guidance
    try:
        prior = load_prior(guidance.prior, dataclasses.replace(Loading.of(config), economy=Economy(), budget=Budget()))
    except PriorError as error:
        if error.code in _REFUSED:
            raise
        return f"{guidance.prior}: {error}", None
    if config.method == "projection":
        sampling_prior(prior, "projection")
    else:
        require(prior, guidance.loss)
    text = f"{prior.spec.id}: {prior.spec.family}, {prior.spec.licence or 'licence not stated'}"
    return text, prior.spec.guidance_scale


def _choice(request: Request, step: Beside, device: torch.device) -> Choice | None:
    """What a large prior that is on this machine would do to save memory; None for all others.

    Raises:
        PriorError: it does not fit into ``compute.memory``.
    """
    config = request.config
    try:
        loading = Loading.of(config, device, beside=step)
        return plan_memory(config.guidance.prior, loading)
    except PriorError as error:
        if error.code in ("prior.memory", "prior.tiny"):
            raise
        return None  # what is wrong with it stands beside its name


def _guidance(config: PaintConfig, own: float | None) -> str:
    """The scale of guidance in words; ``own`` is the prior's."""
    projects = config.method == "projection"
    given = (config.projection if projects else config.guidance).scale
    if own is None and given is None:
        return "the prior's own scale"
    used = with_scales(config, own or 0.0)
    if projects:
        text = f"scale {used.projection.scale:g}"
    else:
        end = used.guidance.scale_end
        text = f"scale {used.guidance.scale:g}" + ("" if end is None else f", falling to {end:g}")
    return text + (", from the prior's own" if given is None else "")
