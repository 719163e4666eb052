"""What is said to the prior: a template around the prompt, a view word per camera, a negative prompt (supp. A.2)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from torch import Tensor

from paintit.config import PaintConfig
from paintit.errors import UsageError

#: View words, from the official script: see :func:`view_word`.
VIEWS = ("front", "side", "back", "overhead")


def view_word(azimuth: float, elevation: float) -> str:
    """The word for a camera at ``azimuth``, ``elevation`` (radians; azimuth 0 looks at the front).

    >>> [view_word(math.radians(a), 0.0) for a in (0, 40, 90, 180, -170, 270, 330)]
    ['front', 'front', 'side', 'back', 'back', 'side', 'front']
    >>> view_word(0.0, math.radians(50))
    'overhead'
    """
    if elevation > math.pi / 4:
        return "overhead"
    off_front = abs(math.remainder(azimuth, 2 * math.pi))
    if off_front <= math.pi / 4:
        return "front"
    return "back" if off_front >= 3 * math.pi / 4 else "side"


class Prompts:
    """The words for every view of one paint.

    Args:
        prompt: what to paint.
        template: ``{prompt}`` and, optionally, ``{view}`` are filled in.
        negative: what the unconditional half sees.
        focus: names of the focus regions; a view of one is worded ``a NAME of PROMPT``.
        source: words for how a paint looks so far, added to each text; empty where the loss asks for none.
        empty: whether the loss asks for the empty prompt.

    Attributes:
        sent: prompts handed out so far, each once, in the order of first use.

    Raises:
        UsageError: an empty prompt, or a template without ``{prompt}`` or with an unknown field.
    """

    def __init__(
        self,
        prompt: str,
        template: str,
        negative: str = "",
        focus: Sequence[str] = (),
        source: str = "",
        empty: bool = False,
    ) -> None:
        if not prompt.strip():
            raise UsageError("prompt.empty", f"the prompt is empty: '{prompt}'", "say what the object should look like")
        fields = re.findall(r"{(\w*)}", template)
        if "prompt" not in fields:
            raise UsageError(
                "prompt.template", f"the template '{template}' has no {{prompt}}", "write {prompt} where it should go"
            )
        for name in fields:
            if name not in ("prompt", "view"):
                raise UsageError(
                    "prompt.template", f"the template has an unknown field {{{name}}}", "use {prompt} and {view}"
                )
        self.prompt = prompt.strip()
        self.template = template
        self.negative = negative
        self.focus = tuple(focus)
        self.source = source
        self.empty = empty
        self.sent: list[str] = []

    @classmethod
    def of(cls, prompt: str, config: PaintConfig, focus: Sequence[str] = ()) -> Prompts:
        """As the settings have it; the texts that only some losses need are asked for only then."""
        words, guidance = config.prompt, config.guidance
        distils = config.method == "distillation"
        source = words.source if distils and guidance.loss == "bridge" else ""
        empty = distils and (guidance.perp_neg or guidance.loss == "nfsd")
        return cls(prompt, words.template, words.negative, focus, source, empty)

    def text(self, view: str, focus: str = "") -> str:
        """The full text for one view word and, for a focus view, the region's name."""
        subject = f"{_article(focus)} {focus} of {self.prompt}" if focus else self.prompt
        # {view} first, so that braces in the user's own words stay as they are.
        return self.template.replace("{view}", view).replace("{prompt}", subject)

    def distinct(self) -> tuple[str, ...]:
        """Every text that can be asked for, the negative one first: what to encode once, before the loop."""
        texts = [self.text(view, name) for name in ("", *self.focus) for view in VIEWS]
        sources = [self.with_source(text) for text in texts] if self.source else []
        return tuple(dict.fromkeys([self.negative, *([""] if self.empty else []), *texts, *sources]))

    def with_source(self, text: str) -> str:
        """``text`` with the words for how a paint looks so far."""
        return f"{text}, {self.source}"

    def for_views(self, azimuth: Tensor, elevation: Tensor, focus: Sequence[str] = ()) -> list[str]:
        """One text per view, noted in :attr:`sent`.

        Args:
            azimuth, elevation: (n,) radians.
            focus: name of the region that each view looks at, ``""`` for the whole; empty: all look at the whole.
        """
        angles = zip(azimuth.tolist(), elevation.tolist(), strict=True)
        names = focus or [""] * len(azimuth)
        texts = [self.text(view_word(a, e), name) for (a, e), name in zip(angles, names, strict=True)]
        self.sent.extend(text for text in dict.fromkeys(texts) if text not in self.sent)
        return texts


def _article(noun: str) -> str:
    return "an" if noun[:1].lower() in "aeiou" else "a"
