"""Train the pocket prior: ``python train.py --minutes 85``; stop and start again at will; ``--smoke`` for a tiny run.

First the two lessons of ``lessons.py`` (minutes); then the whole network learns to denoise, with the first lesson kept
as a small side loss. The weights that ship are a moving average, exported every few
minutes into ``work/run``; ``--ship`` copies them into the package at the end. Torch and numpy do all but the writing of
the exported file (safetensors). On a GPU the same command trains there: ``--batch 512`` and its share of ``--lr`` fit.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import math
import shutil
import time
from dataclasses import asdict
from pathlib import Path

import torch
import torch.nn.functional as F
from captions import all_words
from data import load, load_geometry
from gbuffers import WORK
from lessons import Reading, Said, Sentences, place_lesson, text_lesson
from torch import Tensor, nn

from paintit.guidance.pocket_net import PocketConfig, PocketNet, alpha_sigma

WEIGHTS = Path(__file__).parents[2] / "src" / "paintit" / "guidance" / "pocket.safetensors"
EMA = 0.999
#: Weight of the text encoder's side loss, share of captions and of geometry left out, weight of the background.
SIDE, NO_TEXT, NO_GEOMETRY, OUTSIDE = 0.1, 0.1, 0.15, 0.2
#: Noise levels are drawn as a uniform number to this power: more often where painting asks.
LATE = 0.7


def batches(count: int, size: int, generator: torch.Generator):
    """Endless random index batches, each sample once per epoch."""
    size = min(size, count)
    while True:
        order = torch.randperm(count, generator=generator)
        for start in range(0, count - size + 1, size):
            yield order[start : start + size]


def export(net: nn.Module, config: PocketConfig, path: Path, notes: dict[str, str]) -> str:
    """Write bf16 weights with the configuration in the metadata; returns the SHA-256 of the file."""
    from safetensors.torch import save_file

    tensors = {name: value.detach().to("cpu", torch.bfloat16).contiguous() for name, value in net.state_dict().items()}
    temporary = path.with_suffix(".part")
    save_file(tensors, str(temporary), {"config": json.dumps(asdict(config)), **notes})
    temporary.chmod(0o644)
    temporary.replace(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Examples:
    """The training set in memory; batches are made on ``device``."""

    def __init__(self, data: Path, gbuffers: Path, device: torch.device) -> None:
        self.stack, self.view, means, self.captions = load(data)
        self.geometry, self.device = load_geometry(gbuffers), device
        self.means = means[:, 3:] * 2 - 1
        if device.type == "cuda":
            self.stack, self.geometry = self.stack.to(device), self.geometry.to(device)

    def varied(self) -> Tensor:
        """Numbers of the samples whose base colour is not even."""
        found = []
        for index in torch.arange(len(self.captions)).split(1000):
            x, shown, _ = self.clean(index)
            inside = (shown[:, 3:4] > 0.9).float()
            area = inside.sum((2, 3), keepdim=True).clamp_min(1)
            base = x[:, 3:6] * inside
            spread = ((base - base.sum((2, 3), keepdim=True) / area).square() * inside).sum((1, 2, 3)) / area.flatten()
            found.append(index[(spread > 0.02).cpu()])
        return torch.cat(found)

    def clean(self, index: Tensor) -> tuple[Tensor, Tensor, list[str]]:
        """Stacks in [-1, 1], geometry and captions of samples ``index``."""
        x = self.stack[index.to(self.stack.device)].to(self.device).float() / 127.5 - 1
        shown = self.geometry[self.view[index].to(self.geometry.device)].to(self.device).float()
        return x, shown, [self.captions[i] for i in index.tolist()]

    def noisy(self, index: Tensor, generator: torch.Generator) -> tuple[Tensor, ...]:
        """x_t, t, geometry (some left out), v target and pixel weight of samples ``index``; half are mirrored."""
        x, shown, _ = self.clean(index)
        n = len(index)
        draw = torch.rand(3, n, generator=generator).to(self.device)
        flip = draw[0] < 0.5
        x[flip], shown[flip] = x[flip].flip(-1), shown[flip].flip(-1)
        shown[flip, 0] *= -1
        weight = OUTSIDE + (1 - OUTSIDE) * shown[:, 3:4]
        shown = shown * (draw[1] >= NO_GEOMETRY).float()[:, None, None, None]
        t = 0.02 + 0.98 * draw[2] ** LATE
        alpha, sigma = (a[:, None, None, None] for a in alpha_sigma(t))
        noise = torch.randn(x.shape, generator=generator).to(self.device)
        return alpha * x + sigma * noise, t, shown, alpha * noise - sigma * x, weight


def losses(
    net: PocketNet, reading: Reading, examples: Examples, index: Tensor, fresh: tuple[list[str], Said],
    generator: torch.Generator,
) -> tuple[Tensor, ...]:  # fmt: skip
    """Denoising loss, its part on the material channels, and the text encoder's side loss, on ``fresh`` sentences too."""
    x_t, t, shown, target, weight = examples.noisy(index, generator)
    dropped = torch.rand(len(index), generator=generator) < NO_TEXT
    prompts = ["" if d else examples.captions[i] for i, d in zip(index.tolist(), dropped.tolist(), strict=True)]
    with torch.autocast(x_t.device.type, torch.bfloat16):
        text = net.text(prompts, 0.1, generator)
        v = net(x_t.contiguous(memory_format=torch.channels_last), t, text, shown)
    error = (v.float() - target).square() * weight
    kept = (~dropped).to(x_t.device)
    mean = net.mean(text[:, 0, :-1].float())[kept]
    side = F.smooth_l1_loss(mean, examples.means[index].to(x_t.device)[kept], beta=0.1)
    with torch.autocast(x_t.device.type, torch.bfloat16):
        summary = net.text(fresh[0], 0.1, generator)[:, 0, :-1].float()
    side = side + reading.loss(summary, fresh[1])
    area = weight.sum()
    return error.sum() / (area * 8), error.detach()[:, 3:].sum() / (area * 5), side


def rate(progress: float, step: int, peak: float) -> float:
    """Learning rate: warm-up, level for 30 % of the run, then a cosine to 3 %."""
    fall = 0.5 + 0.5 * math.cos(math.pi * min(1.0, max(0.0, progress - 0.3) / 0.7))
    return peak * min(1, (step + 1) / 150) * (0.03 + 0.97 * fall)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--minutes", type=float, default=85.0, help="of training, over all runs; the schedule follows it"
    )
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--lr", type=float, default=1e-3)
    parser.add_argument("--text-steps", type=int, default=2000, help="of the first lesson")
    parser.add_argument("--place-steps", type=int, default=7000, help="of the second lesson")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--export-minutes", type=float, default=6.0)
    parser.add_argument("--gbuffers", type=Path, default=WORK / "gbuffers")
    parser.add_argument("--data", type=Path, default=WORK / "data")
    parser.add_argument("--out", type=Path, default=WORK / "run")
    parser.add_argument("--init", type=Path, help="a checkpoint whose tensors of like name and shape to start from")
    parser.add_argument("--ship", action="store_true", help="put the finished weights into the package")
    parser.add_argument("--smoke", action="store_true", help="a few steps of a tiny network")
    a = parser.parse_args()
    config = PocketConfig()
    if a.smoke:
        config = PocketConfig(
            width=16, deep=48, deep_blocks=1, shallow_blocks=1, text_width=48, table_width=16, words=256, grams=256,
            pixel=16, filters=4,
        )  # fmt: skip
        a.text_steps, a.place_steps, a.minutes = 10, 10, 0.2
    torch.set_num_threads(a.threads)
    a.out.mkdir(parents=True, exist_ok=True)
    generator = torch.Generator().manual_seed(0)
    torch.manual_seed(0)
    device = torch.device(a.device)
    examples = Examples(a.data, a.gbuffers, device)
    words, weights, checkpoint = json.dumps(all_words()), a.out / "pocket.safetensors", a.out / "last.pt"

    def log(record: dict[str, object]) -> None:
        with (a.out / "log.jsonl").open("a") as file:
            file.write(json.dumps(record) + "\n")

    net = PocketNet(config).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = copy.deepcopy(net).requires_grad_(False)
    reading, sentences = Reading(config.text_width).to(device), Sentences(0)
    parameters = [*net.parameters(), *reading.parameters()]
    optimizer = torch.optim.AdamW(parameters, lr=a.lr, weight_decay=1e-2, betas=(0.9, 0.99), fused=True)
    step, before = 0, 0.0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True, map_location=device)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["average"])
        reading.load_state_dict(state["reading"])
        sentences = Sentences(state["step"])
        optimizer.load_state_dict(state["optimizer"])
        step, before = state["step"], state["seconds"]
        generator.manual_seed(step)
    else:
        if a.init:
            mine, theirs = net.state_dict(), torch.load(a.init, weights_only=True, map_location=device)["net"]
            taken = {name: value for name, value in theirs.items() if name in mine and mine[name].shape == value.shape}
            net.load_state_dict(mine | taken)
            log({"init": len(taken), "of": len(mine)})
        text_lesson(net, reading, sentences, a.text_steps, generator, log)
        varied = examples.varied()
        order = batches(len(varied), a.batch, generator)
        place_lesson(net, lambda: examples.clean(varied[next(order)]), a.place_steps, log)
        average.load_state_dict(net.state_dict())

    def save(seconds: float) -> str:
        state = {"net": net.state_dict(), "average": average.state_dict(), "reading": reading.state_dict()}
        state["optimizer"] = optimizer.state_dict()
        temporary = checkpoint.with_suffix(".part")
        torch.save({**state, "step": step, "seconds": seconds}, temporary)
        temporary.replace(checkpoint)
        return export(average, config, weights, {"step": str(step), "words": words})

    stream, started = batches(len(examples.captions), a.batch, generator), time.monotonic()
    exported, sums, count = started, torch.zeros(3), 0
    while (seconds := before + time.monotonic() - started) < 60 * a.minutes:
        for group in optimizer.param_groups:
            group["lr"] = rate(seconds / (60 * a.minutes), step, a.lr)
        loss, material, side = losses(net, reading, examples, next(stream), sentences(a.batch), generator)
        (loss + SIDE * side).backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        optimizer.zero_grad()
        step += 1
        decay = min(EMA, step / (step + 20))
        with torch.no_grad():
            torch._foreach_lerp_(list(average.parameters()), list(net.parameters()), 1 - decay)
        sums += torch.stack([loss.detach(), material, side.detach()]).cpu()
        count += 1
        if count == 50:
            names = ("loss", "material", "text")
            means = {name: round(value, 4) for name, value in zip(names, (sums / 50).tolist(), strict=True)}
            log({"step": step, "seconds": round(seconds), "lr": round(optimizer.param_groups[0]["lr"], 6), **means})
            sums, count = torch.zeros(3), 0
        if time.monotonic() - exported > 60 * a.export_minutes:
            exported = time.monotonic()
            log({"step": step, "seconds": round(seconds), "sha256": save(seconds)})
    log({"step": step, "seconds": round(seconds), "sha256": save(seconds), "done": True})
    if a.ship:
        shutil.copyfile(weights, WEIGHTS)


if __name__ == "__main__":
    main()
