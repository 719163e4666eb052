"""Painting into a run folder: check everything that can fail, paint with a log and checkpoints, export, or resume.

The painter knows nothing of files; this turns its records into them. Nothing here draws a random number, so a run that
was killed and resumed gives the same bytes as one that was not.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from paintit import api
from paintit.config import PaintConfig, to_dict
from paintit.device import choose_device
from paintit.errors import OutputError, PaintitError, RunError
from paintit.export.image import write_maps
from paintit.export.preview import preview, turntable, write_turntable
from paintit.export.read_maps import unpainted_maps
from paintit.export.seams import seam_figure
from paintit.export.write import write
from paintit.files import atomic, make_folder, output_error
from paintit.guidance.load import load_prior
from paintit.guidance.prior import Prior, TextReleasing
from paintit.mesh.mesh import Mesh
from paintit.paint import checkpoint
from paintit.paint.footprint import loading_for
from paintit.paint.make import make_painter
from paintit.paint.method import Method, Step
from paintit.render.light import load_environment, prefilter
from paintit.run import record as records
from paintit.run.folder import RunFolder, find, locked
from paintit.run.record import Record
from paintit.run.request import Request, check, load, settings_of
from paintit.settings import dump_toml, names, validate

#: Seconds between checkpoints.
CHECKPOINT_EVERY = 10.0


@dataclass(frozen=True)
class Job:
    """A request that passed every check; nothing has been written yet."""

    request: Request
    folder: RunFolder
    mesh: Mesh
    prompt: str
    painter: Method
    resumed: Record | None = None

    @property
    def finished(self) -> bool:
        """The run that is resumed had already finished: it is only exported again."""
        return self.resumed is not None and self.painter.step >= self.painter.total


@dataclass(frozen=True)
class Done:
    """A finished or stopped run."""

    folder: RunFolder
    record: Record
    result: api.PaintResult
    files: tuple[Path, ...] = ()


def prepare(request: Request, prior: Prior | None = None) -> Job:
    """Check the request in the order in which mistakes are cheap to find; load mesh, light and prior; write nothing.

    Args:
        request: what was asked for.
        prior: a diffusion prior; by default the one that the settings name.

    Raises:
        PaintitError: whatever is wrong with settings, output, mesh, light or prior.
    """
    if request.resume is not None:
        return _resume(request, request.resume, prior)
    found = check(request)
    return Job(request, found.folder, found.mesh, found.prompt, _painter(found.mesh, found.prompt, request, prior))


def _painter(mesh: Mesh, prompt: str, request: Request, prior: Prior | None) -> Method:
    config = request.config
    device, _ = choose_device(config.device)
    environment = load_environment(config.light.path, config.light.exposure)  # before the prior, which may take minutes
    ours = prior or load_prior(config.guidance.prior, loading_for(mesh, config, device, request.allow_download))
    fixed = unpainted_maps(mesh, config.texture.size)
    painter = make_painter(mesh, prompt, config, ours, prefilter(environment, device), fixed)
    if prior is None and isinstance(ours, TextReleasing):
        ours.release_texts()
    return painter


def _resume(request: Request, named: Path, prior: Prior | None) -> Job:
    validate(request.config)
    path = find(named)
    old = records.read(path / "run.json")
    folder = RunFolder(path, path / old.asset)
    config = settings_of(path)
    _same_settings(config, request.config)
    if request.prompt is not None and api.check_prompt(request.prompt) != old.prompt:
        raise RunError("run.differs", f"the run's prompt is '{old.prompt}', not '{request.prompt.strip()}'",
                       "leave the prompt out, or start a new run")  # fmt: skip
    mesh = load(request.mesh or _recorded_input(folder, old), config)
    digest = mesh.source.sha256 if mesh.source else ""
    if digest != old.input.get("sha256"):
        raise RunError(
            "run.differs", f"the mesh is not the one of this run: {old.input.get('name')} had sha256 "
            f"{str(old.input.get('sha256'))[:12]}, this file has {digest[:12]}", "give the original file",
        )  # fmt: skip
    painter = _painter(mesh, old.prompt, dataclasses.replace(request, config=config), prior)
    added, before = list(painter.prior.spec.added), list(old.prior.get("added", []))
    if added != before:
        raise RunError(
            "run.differs", f"the prior has {' and '.join(added) or 'no additions'} here, "
            f"{' and '.join(before) or 'none'} in the run", "give the original files",
        )  # fmt: skip
    if folder.checkpoint.exists():
        checkpoint.load(folder.checkpoint, painter)
    return Job(request, folder, mesh, old.prompt, painter, old)


def _same_settings(old: PaintConfig, new: PaintConfig) -> None:
    for name in names():
        before, after = _value(old, name), _value(new, name)
        if before != after and not (after is None and name.endswith(".scale")):  # whatever it was is the prior's own
            raise RunError("run.differs", f"{name} is {before} in the run, {after} here",
                           f"leave --{name.replace('_', '-')} out, or start a new run")  # fmt: skip


def _value(config: Any, name: str) -> Any:
    for part in name.split("."):
        config = getattr(config, part)
    return config


def _recorded_input(folder: RunFolder, old: Record) -> Path:
    try:
        path = folder.folder / folder.input.read_text("utf-8").strip()
    except OSError:
        path = Path(str(old.input.get("name")))
    if not path.exists():
        raise RunError("run.no_mesh", f"the mesh {old.input.get('name')} of this run is not where it was",
                       f"write: paintit paint MESH --resume {folder.folder}")  # fmt: skip
    return Path(os.path.normpath(path))


def run(
    job: Job,
    on_step: Callable[[Step], None] | None = None,
    stop: Callable[[], bool] = lambda: False,
    checkpoint_every: float = CHECKPOINT_EVERY,
) -> Done:
    """Paint the job into its folder, or go on where its checkpoint is.

    Args:
        job: from :func:`prepare`.
        on_step: told of every step.
        stop: asked after every step; once true, a checkpoint is written and the run ends as ``stopped``.
        checkpoint_every: seconds between checkpoints.

    Raises:
        RunError: another process paints into the folder.
        OutputError: it cannot be written to.
        PaintitError: the run diverged; the record says so, and the last checkpoint stays.
    """
    with locked(job.folder):
        if job.resumed is None and job.request.overwrite:
            job.folder.clear()
        record = _start(job)
        start = time.perf_counter()
        try:
            history = [] if job.finished else _paint(job, on_step, stop, checkpoint_every)
            seconds = record.seconds + time.perf_counter() - start
            result = api.result_of(job.painter, job.prompt, tuple(history), seconds, stopped=True)
            done = job.painter.step >= job.painter.total
            files, seam = _export(job, result) if done else ((), None)
        except BaseException as error:
            _failed(job, record, error, time.perf_counter() - start)
            raise
        record = dataclasses.replace(
            record, state="finished" if done else "stopped", outcome=result.outcome, step=job.painter.step,
            ended=records.now(), seconds=round(seconds, 3), peak_memory=result.peak_memory,
            prompts=_prompts(job.painter), seam=seam,
        )  # fmt: skip
        records.write(job.folder.record, record)
    return Done(job.folder, record, result, files)


def _start(job: Job) -> Record:
    """Write what is known before the first step; a resumed run keeps what its first sitting wrote."""
    folder, painter, mesh = job.folder, job.painter, job.mesh
    if job.resumed is not None:
        record = dataclasses.replace(job.resumed, state="running", outcome="running", ended="")
        records.write(folder.record, record)
        return record
    make_folder(folder.checkpoint.parent)
    with atomic(folder.config) as temporary:
        temporary.write_text(dump_toml(painter.config), "utf-8")  # the scales that the prior gave are kept
    source = mesh.source
    if source is not None:
        with atomic(folder.input) as temporary:
            temporary.write_text(_relative(source.path, folder.folder) + "\n", "utf-8")
    record = Record(
        steps=painter.total,
        asset=Path(_relative(folder.asset, folder.folder)).as_posix(),
        prompt=job.prompt,
        prompts=_prompts(painter),
        readings=painter.readings,
        command=records.without_folders(job.request.command),
        started=records.now(),
        seed=painter.config.seed,
        device=str(painter.device),
        device_reason=painter.device_reason,
        input={
            "name": source.path.name if source else "",
            "sha256": source.sha256 if source else "",
            "faces": len(mesh.faces),
            "layers": [layer.name for layer in mesh.layers],
            "painted": [layer.name for layer in mesh.layers if layer.painted],
            "uvs": mesh.report.uv_origin,
        },
        prior=records.without_folders(to_dict(painter.prior.spec)),
        light={
            "name": painter.light.name,
            "sha256": painter.light.sha256,
            "exposure_factor": painter.light.exposure_factor,
        },
        versions=records.versions(),
        config=records.without_folders(to_dict(painter.config)),
        notes=painter.notes,
    )
    records.write(folder.record, record)
    return record


def _prompts(painter: Method) -> tuple[str, ...]:
    return tuple(painter.sent_prompts)


def _relative(path: Path, folder: Path) -> str:
    try:
        return os.path.relpath(path, folder)
    except ValueError:  # another drive, on Windows
        return str(path.absolute())


def _failed(job: Job, record: Record, error: BaseException, seconds: float) -> None:
    """Note the end of a run that did not reach its end; the error itself goes on to the caller."""
    if isinstance(error, KeyboardInterrupt):
        state, outcome = "stopped", f"interrupted after {job.painter.step} of {job.painter.total} steps"
    else:
        word = str(error) if isinstance(error, PaintitError) else type(error).__name__
        step, total = job.painter.step, job.painter.total
        where = f"at step {step + 1} of {total}" if step < total else "while the result was written"
        state, outcome = "failed", f"failed {where}: {word}"
    record = dataclasses.replace(
        record, state=state, outcome=outcome, step=job.painter.step, ended=records.now(),
        seconds=round(record.seconds + seconds, 3),
    )  # fmt: skip
    with contextlib.suppress(OutputError):  # where the disk is full, that is the error itself
        records.write(job.folder.record, record)


def _paint(job: Job, on_step: Callable[[Step], None] | None, stop: Callable[[], bool], every: float) -> list[Step]:
    folder, painter, request = job.folder, job.painter, job.request
    history: list[Step] = []
    _forget_after(folder, painter.step)
    saved = time.monotonic()
    try:
        with open(folder.log, "a", encoding="utf-8") as log:
            for step in painter:
                history.append(step)
                _log(log, step)
                if request.snapshot_every and painter.step % request.snapshot_every == 0:
                    _image(folder.snapshot(painter.step), preview(job.mesh, painter.maps(), size=256, views=2))
                stopping = stop()
                if stopping or painter.step == painter.total or time.monotonic() - saved >= every:
                    checkpoint.save(folder.checkpoint, painter)
                    saved = time.monotonic()
                if on_step is not None:
                    on_step(step)
                if stopping:
                    break
    except OSError as error:
        raise output_error(folder.log, error) from error
    return history


def _log(log: IO[str], step: Step) -> None:
    log.write(json.dumps(dataclasses.asdict(step)) + "\n")
    log.flush()


def _forget_after(folder: RunFolder, step: int) -> None:
    """Cut the log and the snapshots back to ``step``, the checkpoint's: what came after it is painted again."""
    if folder.log.exists():
        lines = folder.log.read_text("utf-8", "replace").splitlines(keepends=True)
        with atomic(folder.log) as temporary:
            temporary.write_text("".join(lines[:step]), "utf-8")
    for path in folder.snapshots.glob("step-*.png"):
        if int(path.stem.removeprefix("step-")) > step:
            path.unlink(missing_ok=True)


def _export(job: Job, result: api.PaintResult) -> tuple[tuple[Path, ...], dict[str, Any] | None]:
    """Everything that is made of the maps, the asset last, so that where it is, all is; and the ``seam`` figure."""
    folder, ready = job.folder, result.finished()
    light = job.painter.config.light.path
    files = [folder.asset, folder.textures]
    write_maps(folder.textures, ready.mesh, ready.maps)
    if job.request.preview:
        _image(folder.preview, preview(ready.mesh, ready.maps, light_path=light))
        files.append(folder.preview)
    if job.request.turntable:
        write_turntable(folder.turntable, turntable(ready.mesh, ready.maps, light_path=light))
        files.append(folder.turntable)
    seam = seam_figure(ready.mesh, ready.maps)
    write(folder.asset, ready.mesh, ready.maps, ready.metadata, overwrite=True)
    return tuple(files), dataclasses.asdict(seam) | {"worst_at": list(seam.worst_at)} if seam else None


def _image(path: Path, image: Any) -> None:
    with atomic(path) as temporary:
        image.save(temporary)
