"""Train the pocket prior: ``python train.py --minutes 55``; stop and start again at will; ``--smoke`` for a tiny run.

First lesson (minutes): the text encoder alone learns each caption's mean material. Then the whole network learns to
denoise, with the first lesson kept as a small side loss. The weights that ship are a moving average, exported every few
minutes.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import math
import time
from dataclasses import asdict
from pathlib import Path

import torch
import torch.nn.functional as F
from data import load
from gbuffers import WORK
from safetensors.torch import save_file
from torch import Tensor, nn

from paintit.guidance.pocket_net import PocketConfig, PocketNet, alpha_sigma

WEIGHTS = Path(__file__).parents[2] / "src" / "paintit" / "guidance" / "pocket.safetensors"
EMA = 0.999


def batches(count: int, size: int, generator: torch.Generator):
    """Endless random index batches, each sample once per epoch."""
    while True:
        order = torch.randperm(count, generator=generator)
        for start in range(0, count - size + 1, size):
            yield order[start : start + size]


def export(net: nn.Module, config: PocketConfig, path: Path, notes: dict[str, str]) -> str:
    """Write bf16 weights with the configuration in the metadata; returns the SHA-256 of the file."""
    tensors = {name: value.detach().to(torch.bfloat16).contiguous() for name, value in net.state_dict().items()}
    temporary = path.with_suffix(".part")
    save_file(tensors, str(temporary), {"config": json.dumps(asdict(config)), **notes})
    temporary.chmod(0o644)
    temporary.replace(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def text_lesson(
    net: PocketNet,
    head: nn.Module,
    means: Tensor,
    captions: list[str],
    steps: int,
    size: int,
    generator: torch.Generator,
    log,
) -> None:
    """Regress (base colour, roughness, metalness) means in [-1, 1] from the summary token."""
    parameters = [*net.text.parameters(), *head.parameters()]
    optimizer = torch.optim.AdamW(parameters, lr=2e-3, weight_decay=1e-4, fused=True)
    stream, total = batches(len(captions), size, generator), 0.0
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = 2e-3 * min(1, (step + 1) / 50) * (1 - 0.8 * step / steps)
        index = next(stream)
        with torch.autocast("cpu", torch.bfloat16):
            text = net.text([captions[i] for i in index.tolist()], 0.1, generator)
        loss = F.smooth_l1_loss(head(text[:, 0, :-1].float()), means[index, 3:] * 2 - 1, beta=0.1)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        total += float(loss.detach())
        if (step + 1) % 50 == 0:
            log({"lesson": "text", "step": step + 1, "loss": round(total / 50, 4)})
            total = 0.0


def noisy_batch(stack: Tensor, geometry: Tensor, generator: torch.Generator) -> tuple[Tensor, ...]:
    """x_t, t, geometry (some dropped), v target and pixel weight from uint8 samples; half are mirrored."""
    x, shown = stack.float() / 127.5 - 1, geometry.float() / 255
    shown = torch.cat([shown[:, :3] * 2 - 1, shown[:, 3:]], 1)
    shown[:, :3] *= shown[:, :3].abs() > 0.01
    flip = torch.rand(len(x), generator=generator) < 0.5
    x[flip], shown[flip] = x[flip].flip(-1), shown[flip].flip(-1)
    shown[flip, 0] *= -1
    weight = 0.3 + 0.7 * shown[:, 3:]
    shown = shown * (torch.rand(len(x), 1, 1, 1, generator=generator) >= 0.15)
    t = 0.02 + 0.98 * torch.rand(len(x), generator=generator)
    alpha, sigma = (a[:, None, None, None] for a in alpha_sigma(t))
    noise = torch.randn(x.shape, generator=generator)
    return alpha * x + sigma * noise, t, shown, alpha * noise - sigma * x, weight


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=55.0)
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--lr", type=float, default=1e-3)
    parser.add_argument("--text-steps", type=int, default=500)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--export-minutes", type=float, default=8.0)
    parser.add_argument("--data", type=Path, default=WORK / "data")
    parser.add_argument("--out", type=Path, default=WORK / "run")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--smoke", action="store_true", help="a few steps of a tiny network, weights beside the run")
    a = parser.parse_args()
    config = PocketConfig()
    if a.smoke:
        config = PocketConfig(
            width=16, deep=48, deep_blocks=1, shallow_blocks=1, text_width=48, table_width=16, words=256, grams=256
        )
        a.text_steps, a.minutes, a.out, a.weights = 10, 0.1, WORK / "smoke", WORK / "smoke.safetensors"
    torch.set_num_threads(a.threads)
    a.out.mkdir(parents=True, exist_ok=True)
    generator = torch.Generator().manual_seed(0)
    torch.manual_seed(0)
    stack, geometry, means, captions = load(a.data)

    def log(record: dict[str, object]) -> None:
        with (a.out / "log.jsonl").open("a") as file:
            file.write(json.dumps(record) + "\n")

    net = PocketNet(config).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    head = nn.Linear(config.text_width, 5)
    average = copy.deepcopy(net).requires_grad_(False)
    optimizer = torch.optim.AdamW(
        [*net.parameters(), *head.parameters()], lr=a.lr, weight_decay=1e-2, betas=(0.9, 0.99), fused=True
    )
    step, before, checkpoint = 0, 0.0, a.out / "last.pt"
    if checkpoint.exists() and not a.smoke:
        state = torch.load(checkpoint, weights_only=True)
        (
            net.load_state_dict(state["net"]),
            average.load_state_dict(state["average"]),
            head.load_state_dict(state["head"]),
        )
        optimizer.load_state_dict(state["optimizer"])
        step, before = state["step"], state["seconds"]
        generator.manual_seed(step)
    else:
        text_lesson(net, head, means, captions, a.text_steps, 256, generator, log)
        average.load_state_dict(net.state_dict())
    stream, started = batches(len(captions), a.batch, generator), time.monotonic()
    exported, sums, count = started, torch.zeros(3), 0
    while True:
        seconds = before + time.monotonic() - started
        progress = seconds / (60 * a.minutes)
        if progress >= 1:
            break
        rate = (
            a.lr
            * min(1, (step + 1) / 150)
            * (0.03 + 0.97 * (0.5 + 0.5 * math.cos(math.pi * max(0, progress - 0.3) / 0.7)))
        )
        for group in optimizer.param_groups:
            group["lr"] = rate
        index = next(stream)
        x_t, t, shown, target, weight = noisy_batch(stack[index], geometry[index], generator)
        dropped = torch.rand(len(index), generator=generator) < 0.1
        prompts = ["" if d else captions[i] for i, d in zip(index.tolist(), dropped.tolist(), strict=True)]
        with torch.autocast("cpu", torch.bfloat16):
            text = net.text(prompts, 0.1, generator)
            v = net(x_t.contiguous(memory_format=torch.channels_last), t, text, shown)
        error = (v.float() - target).square() * weight
        side = F.smooth_l1_loss(head(text[:, 0, :-1].float()), means[index, 3:] * 2 - 1, beta=0.1, reduction="none")[
            ~dropped
        ].mean()
        loss = error.sum() / (weight.sum() * config.channels)
        (loss + 0.1 * side).backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
        optimizer.zero_grad()
        step += 1
        decay = min(EMA, step / (step + 20))
        with torch.no_grad():
            torch._foreach_lerp_(list(average.parameters()), list(net.parameters()), 1 - decay)
        sums += torch.tensor(
            [float(loss.detach()), float(error.detach()[:, 3:].sum() / (weight.sum() * 5)), float(side.detach())]
        )
        count += 1
        if count == 50:
            names = ("loss", "material", "text")
            log(
                {
                    "step": step,
                    "seconds": round(seconds),
                    "lr": round(rate, 6),
                    **dict(zip(names, (sums / 50).tolist(), strict=True)),
                }
            )
            sums, count = torch.zeros(3), 0
        if time.monotonic() - exported > 60 * a.export_minutes:
            exported = time.monotonic()
            _save(checkpoint, net, average, head, optimizer, step, seconds)
            log({"step": step, "sha256": export(average, config, a.weights, {"step": str(step)})})
    _save(checkpoint, net, average, head, optimizer, step, before + time.monotonic() - started)
    log({"step": step, "sha256": export(average, config, a.weights, {"step": str(step)}), "done": True})


def _save(
    path: Path,
    net: nn.Module,
    average: nn.Module,
    head: nn.Module,
    optimizer: torch.optim.Optimizer,
    step: int,
    seconds: float,
) -> None:
    temporary = path.with_suffix(".part")
    torch.save(
        {
            "net": net.state_dict(),
            "average": average.state_dict(),
            "head": head.state_dict(),
            "optimizer": optimizer.state_dict(),
            "step": step,
            "seconds": seconds,
        },
        temporary,
    )
    temporary.replace(path)


if __name__ == "__main__":
    main()
