"""The network of the pocket prior: a small U-Net over stacks of rendered channels, read by hashed words.

It sees where every pixel lies on the object. A pattern with one phase in object space is then something that can be
learnt exactly, and that agrees between views and between UV islands. Text needs no tokenizer file and no hub: a word is
a learned vector looked up by its hash plus the mean vector of its character n-grams, so a misspelt or compound word
still lands near its parts. One definition for training and use.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from paintit.guidance.places import FEATURES, features


@dataclass(frozen=True)
class PocketConfig:
    """Sizes of the network; stored with the weights."""

    channels: int = 8
    """Denoised: shaded RGB, base colour, roughness, metalness."""
    geometry: int = 10
    """Conditioning: see :func:`pack_geometry`."""
    pixel: int = 64
    """Channels of the layers at full resolution."""
    filters: int = 24
    """Filters over the features of a place that a sentence makes, and as many that all share."""
    resolution: int = 32
    width: int = 80
    """Channels at half resolution."""
    deep: int = 192
    """Channels at quarter resolution."""
    shallow_blocks: int = 2
    deep_blocks: int = 2
    text_width: int = 192
    text_layers: int = 2
    table_width: int = 96
    words: int = 8192
    """Buckets of whole words."""
    grams: int = 8192
    """Buckets of character 3- to 5-grams."""
    max_words: int = 24
    condition: int = 256


def split_words(prompt: str, limit: int) -> list[str]:
    """Lower-cased runs of letters and digits, the first ``limit`` of them."""
    return re.findall(r"[^\W_]+", prompt.lower())[:limit]


def hash_word(word: str, config: PocketConfig) -> tuple[int, list[int]]:
    """Bucket of the word and buckets of its n-grams (of ``<word>``). CRC-32, so the same everywhere."""
    framed = f"<{word[:24]}>"
    grams = {framed[i : i + n] for n in (3, 4, 5) for i in range(len(framed) - n + 1)} or {framed}
    word_bucket = zlib.crc32(word.encode()) % config.words
    return word_bucket, sorted(zlib.crc32(b"#" + g.encode()) % config.grams for g in grams)


def sinusoids(position: Tensor, width: int, longest: float) -> Tensor:
    """(..., width) sine and cosine features of ``position`` (...)."""
    rate = torch.exp(-math.log(longest) * torch.arange(width // 2, device=position.device) / (width // 2))
    angle = position[..., None].float() * rate
    return torch.cat([angle.sin(), angle.cos()], -1)


def attend(q: Tensor, k: Tensor, v: Tensor, heads: int, valid: Tensor | None = None) -> Tensor:
    """Multi-head attention of q (n, a, d) over k, v (n, b, d); ``valid`` (n, b). Plain products: quickest on a CPU."""
    n, a, d = q.shape
    split = lambda x: x.reshape(n, x.shape[1], heads, d // heads).transpose(1, 2)  # noqa: E731
    score = split(q) @ split(k).transpose(-1, -2) * (d // heads) ** -0.5
    if valid is not None:
        score = score.masked_fill(~valid[:, None, None, :], -1e4)
    return (score.softmax(-1).to(v.dtype) @ split(v)).transpose(1, 2).reshape(n, a, d)


class TransformerBlock(nn.Module):
    """Pre-norm self-attention, optional attention over text tokens, and a two-layer perceptron."""

    def __init__(self, width: int, heads: int, text_width: int = 0, expand: int = 2) -> None:
        super().__init__()
        self.heads = heads
        self.norm1, self.qkv, self.out = nn.LayerNorm(width), nn.Linear(width, 3 * width), nn.Linear(width, width)
        if text_width:
            self.norm2, self.query = nn.LayerNorm(width), nn.Linear(width, width)
            self.key_value, self.out2 = nn.Linear(text_width, 2 * width), nn.Linear(width, width)
        self.norm3 = nn.LayerNorm(width)
        self.mlp = nn.Sequential(nn.Linear(width, expand * width), nn.GELU(), nn.Linear(expand * width, width))
        for last in (self.out, self.mlp[2]):
            nn.init.zeros_(last.weight)  # pyright: ignore[reportArgumentType]

    def forward(self, x: Tensor, valid: Tensor | None = None, text: Tensor | None = None,
                text_valid: Tensor | None = None) -> Tensor:  # fmt: skip
        q, k, v = self.qkv(self.norm1(x)).chunk(3, -1)
        x = x + self.out(attend(q, k, v, self.heads, valid))
        if text is not None:
            k, v = self.key_value(text).chunk(2, -1)
            x = x + self.out2(attend(self.query(self.norm2(x)), k, v, self.heads, text_valid))
        return x + self.mlp(self.norm3(x))


class TextEncoder(nn.Module):
    """Prompts -> (n, 1 + longest, width + 1): a summary token and one per word; the last feature is 1 where valid."""

    def __init__(self, config: PocketConfig) -> None:
        super().__init__()
        self.config = config
        self.known: frozenset[str] | None = None
        """Words of the training captions; another's bucket belongs to one of them, so it keeps its n-grams alone."""
        width = config.text_width
        self.word = nn.Embedding(config.words, config.table_width)
        self.gram = nn.EmbeddingBag(config.grams, config.table_width, mode="mean")
        nn.init.zeros_(self.word.weight)  # a word never met adds nothing: its n-grams speak for it
        nn.init.normal_(self.gram.weight, std=0.5)
        self.lift = nn.Linear(config.table_width, width)
        self.summary = nn.Parameter(torch.randn(width) * 0.1)
        self.blocks = nn.ModuleList([TransformerBlock(width, 4) for _ in range(config.text_layers)])
        self.norm = nn.LayerNorm(width)

    def forward(
        self, prompts: Sequence[str], word_dropout: float = 0.0, generator: torch.Generator | None = None
    ) -> Tensor:
        device = self.summary.device
        sentences = [split_words(p, self.config.max_words) for p in prompts]
        index: dict[str, int] = {}
        for word in (w for s in sentences for w in s):
            index.setdefault(word, len(index))
        hashed = [hash_word(w, self.config) for w in index] or [(0, [0])]
        grams = torch.tensor([g for _, gs in hashed for g in gs], device=device)
        offsets = torch.tensor([0, *[len(gs) for _, gs in hashed][:-1]], device=device).cumsum(0)
        whole = self.word(torch.tensor([w for w, _ in hashed], device=device))
        if self.known is not None and index:
            whole = whole * torch.tensor([[float(w in self.known)] for w in index], device=device)
        if word_dropout > 0:
            whole = whole * (torch.rand(len(hashed), 1, generator=generator).to(device) >= word_dropout)
        table = self.lift(whole + self.gram(grams, offsets))
        longest = max(1, *(len(s) for s in sentences)) if sentences else 1
        rows = torch.tensor([[index[w] for w in s] + [0] * (longest - len(s)) for s in sentences], device=device)
        lengths = torch.tensor([len(s) for s in sentences], device=device)
        place = sinusoids(torch.arange(longest, device=device), self.config.text_width, 100.0)
        tokens = table[rows] + 0.3 * place.to(table.dtype)
        x = torch.cat([self.summary.to(tokens.dtype).expand(len(sentences), 1, -1), tokens], 1)
        valid = torch.arange(longest + 1, device=device)[None] <= lengths[:, None]
        for block in self.blocks:
            x = block(x, valid)
        return torch.cat([self.norm(x), valid[..., None].to(x.dtype)], -1)


class ResBlock(nn.Module):
    """Two 3x3 convolutions with a scale and shift from the condition between them."""

    def __init__(self, width: int, condition: int) -> None:
        super().__init__()
        self.norm1, self.conv1 = nn.GroupNorm(8, width), nn.Conv2d(width, width, 3, padding=1)
        self.norm2, self.conv2 = nn.GroupNorm(8, width), nn.Conv2d(width, width, 3, padding=1)
        self.film = nn.Linear(condition, 2 * width)
        nn.init.zeros_(self.conv2.weight)

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        scale, shift = self.film(condition)[:, :, None, None].chunk(2, 1)
        h = self.conv1(F.silu(self.norm1(x)))
        h = self.conv2(F.silu(self.norm2(h) * (1 + scale) + shift))
        return x + h


def pack_geometry(normal: Tensor, mask: Tensor, position: Tensor, normal_object: Tensor, side: int) -> Tensor:
    """Conditioning (n, 10, side, side) from (n, h, w, 3), (n, h, w, 1), (n, h, w, 3), (n, h, w, 3).

    View normal (3), mask, position (3) and normal in normalised object space (3), averaged over areas; the position is
    the mean over what is covered, zero where nothing is.
    """
    packed = torch.cat([normal * mask, mask, position * mask, normal_object * mask], -1).permute(0, 3, 1, 2)
    if min(packed.shape[2:]) < side:
        packed = F.interpolate(packed, (side, side), mode="bilinear", align_corners=False)
    else:
        packed = F.adaptive_avg_pool2d(packed, side)
    covered = packed[:, 3:4]
    return torch.cat([packed[:, :4], packed[:, 4:7] / covered.clamp_min(1e-3), packed[:, 7:]], 1)


class PixelHead(nn.Module):
    """The last layers, pixel by pixel at full resolution: the trunk's output, x_t and the place in, v out.

    The sentence chooses what to look for in the features of a place: ``seek`` makes linear filters over them from the
    condition, one set for each sample.
    """

    def __init__(self, inputs: int, places: int, filters: int, width: int, outputs: int, condition: int) -> None:
        super().__init__()
        self.filters = filters
        self.seek = nn.Linear(condition, filters * (places + 1))
        self.look = nn.Linear(places, filters)
        self.enter = nn.Linear(inputs + 2 * filters, width)
        self.middle = nn.Linear(width, width)
        self.leave = nn.Linear(width, outputs)
        self.film = nn.Linear(condition, 4 * width)
        nn.init.normal_(self.seek.weight, std=0.3 / math.sqrt(20 * condition))
        nn.init.zeros_(self.seek.bias)
        nn.init.zeros_(self.leave.weight)

    def forward(self, x: Tensor, places: Tensor, condition: Tensor) -> Tensor:
        """(n, pixels, inputs), (n, pixels, places), (n, condition) -> (n, pixels, outputs)."""
        sought = self.seek(condition).unflatten(-1, (self.filters, -1))
        found = places @ sought[..., 1:].transpose(1, 2) + sought[..., 0][:, None]
        scale, shift, scale2, shift2 = self.film(condition)[:, None].chunk(4, -1)
        h = self.enter(torch.cat([x, F.silu(found), F.silu(self.look(places))], -1))
        h = F.silu(h * (1 + scale) + shift)
        return self.leave(F.silu(self.middle(h) * (1 + scale2) + shift2))


class PocketNet(nn.Module):
    """v-prediction from a noisy stack, its geometry, the noise level and encoded text."""

    def __init__(self, config: PocketConfig) -> None:
        super().__init__()
        self.config = config
        c, w, d = config.condition, config.width, config.deep
        self.text = TextEncoder(config)
        self.time = nn.Sequential(nn.Linear(64, c), nn.SiLU(), nn.Linear(c, c))
        self.summary = nn.Linear(config.text_width, c)
        places = config.geometry + FEATURES
        self.lift = nn.Linear(places, config.pixel // 2)
        self.stem = nn.Conv2d(4 * (config.channels + config.pixel // 2), w, 3, padding=1)
        self.encoder = nn.ModuleList([ResBlock(w, c) for _ in range(config.shallow_blocks)])
        self.down = nn.Conv2d(4 * w, d, 1)
        self.middle = nn.ModuleList()
        for _ in range(config.deep_blocks):
            self.middle.append(ResBlock(d, c))
            self.middle.append(TransformerBlock(d, 6, config.text_width))
        side = config.resolution // 4
        self.place = nn.Parameter(torch.zeros(1, d, side, side))
        self.up = nn.Conv2d(d, 4 * w, 1)
        self.decoder = nn.ModuleList([ResBlock(w, c) for _ in range(config.shallow_blocks)])
        self.out_norm, self.out = nn.GroupNorm(8, w), nn.Conv2d(w, 4 * 2 * config.channels, 3, padding=1)
        self.head = PixelHead(3 * config.channels, places, config.filters, config.pixel, config.channels, c)
        self.mean = nn.Linear(config.text_width, 5)
        """From the summary token: mean base colour (sRGB-coded), roughness, metalness, in [-1, 1]."""

    @staticmethod
    @torch.no_grad()
    def places(geometry: Tensor, dtype: torch.dtype) -> Tensor:
        """(n, s, s, places): the geometry and the features of each place, channels last as the layers here like it."""
        shown = geometry.float().movedim(1, -1)
        return torch.cat([shown, features(shown[..., 4:7], shown[..., 7:10])], -1).to(dtype)

    def forward(self, x: Tensor, t: Tensor, text: Tensor, geometry: Tensor) -> Tensor:
        """v (n, channels, s, s) of x (same), t (n,) in [0, 1], text of :class:`TextEncoder`, geometry (n, 10, s, s)."""
        autocast = torch.is_autocast_enabled(x.device.type)
        low = torch.get_autocast_dtype(x.device.type) if autocast else x.dtype
        return self.denoise(x.to(low), t, text, self.places(geometry, low))

    def denoise(self, x: Tensor, t: Tensor, text: Tensor, places: Tensor) -> Tensor:
        """:meth:`forward` of geometry that :meth:`places` has been made of, in the type of ``x``."""
        tokens, valid = text[..., :-1], text[..., -1] > 0.5
        time = self.time(sinusoids(t * 1000, 64, 10000.0).to(tokens.dtype))
        condition = F.silu(time + self.summary(tokens[:, 0]))
        lifted = F.silu(self.lift(places)).movedim(-1, 1)
        h = self.stem(F.pixel_unshuffle(torch.cat([x, lifted], 1), 2))
        for block in self.encoder:
            h = block(h, condition)
        skip = h
        h = self.down(F.pixel_unshuffle(h, 2)) + self.place
        n, d, rows, columns = h.shape
        for block in self.middle:
            if isinstance(block, TransformerBlock):
                flat = h.permute(0, 2, 3, 1).reshape(n, rows * columns, d)
                h = block(flat, None, tokens, valid).reshape(n, rows, columns, d).permute(0, 3, 1, 2)
            else:
                h = block(h, condition)
        h = F.pixel_shuffle(self.up(h), 2) + skip
        for block in self.decoder:
            h = block(h, condition)
        h = F.pixel_shuffle(self.out(F.silu(self.out_norm(h))), 2)
        pixels = torch.cat([h.to(x.dtype), x], 1).movedim(1, -1)
        return self.head(pixels.flatten(1, 2), places.flatten(1, 2), condition).unflatten(1, x.shape[2:]).movedim(-1, 1)


def alpha_sigma(t: float | Tensor) -> tuple[Tensor, Tensor]:
    """Cosine schedule: x_t = alpha x + sigma epsilon with alpha = cos(pi t / 2), sigma = sin(pi t / 2)."""
    angle = torch.as_tensor(t, dtype=torch.float32) * (math.pi / 2)
    return angle.cos(), angle.sin()
