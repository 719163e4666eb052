"""What is done under a budget: the cheapest that fits, and a word where nothing does."""

from __future__ import annotations

import dataclasses

import pytest

from paintit.config import PAPER, PaintConfig
from paintit.errors import PriorError
from paintit.guidance.economy import (
    BASE,
    COMPILE_STEPS,
    GB,
    Beside,
    Budget,
    Economy,
    EncoderCost,
    Footprint,
    choose,
    estimate,
)  # fmt: skip
from paintit.settings import merge

#: Stable Diffusion 2.1 in bfloat16 at 512 pixels, as ``footprint`` counts it.
SD21 = Footprint(
    network=1_731_821_448,
    layer=58_984_960,
    texts=680_776_296,
    predict=68_193_416,
    encoder=EncoderCost(weights=167_307_726, saved=1_593_201_152, forward=340_262_912, backward=1_597_460_992),
    tiny=EncoderCost(weights=4_890_126, saved=249_102_340, forward=106_954_760, backward=251_133_960),
)
NOTHING = Economy()
PAINT = Budget(views=4, samples=8, beside=Beside(2_200_000_000, 2_600_000_000), tiny="madebyollin/taesd")


def within(gigabytes: float, given: Economy = NOTHING, footprint: Footprint = SD21, budget: Budget = PAINT) -> Economy:
    choice = choose(footprint, dataclasses.replace(budget, limit=round(gigabytes * GB)), given)
    assert choice.bytes == estimate(footprint, budget, choice.economy)
    assert choice.bytes <= gigabytes * GB
    return choice.economy


def test_without_a_budget_nothing_is_done() -> None:
    assert choose(SD21, PAINT, Economy()).economy == Economy()


def test_the_papers_setting_by_hand() -> None:
    """Weights, what the painter keeps, and four views' activations with the gradient of the last one."""
    peak = 1_731_821_448 + 167_307_726 + 2_200_000_000 + 4 * 1_597_460_992
    predicting = 1_731_821_448 + 167_307_726 + 2_200_000_000 + 4 * 1_593_201_152 + 8 * 68_193_416
    assert estimate(SD21, PAINT, Economy()) == BASE["cuda"] + round(1.05 * max(peak, predicting))


@pytest.mark.parametrize(
    ("gigabytes", "wanted"),
    [
        (16, Economy()),
        (12, Economy(chunk=4)),
        (11.8, Economy(chunk=1)),
        (10, Economy(recompute=2)),
        (8, Economy(recompute=1)),
        (6, Economy(recompute=1, offload=True)),
        (4, Economy(recompute=2, offload=True, tiny="madebyollin/taesd")),
    ],
)
def test_the_cheapest_that_fits_is_taken(gigabytes: float, wanted: Economy) -> None:
    assert within(gigabytes) == wanted


def test_less_memory_is_never_asked_for_than_before() -> None:
    sizes = [estimate(SD21, PAINT, within(limit / 10)) for limit in range(38, 160)]
    assert sizes == sorted(sizes)


def test_large_text_encoders_go_to_the_host_first() -> None:
    heavy = dataclasses.replace(SD21, texts=12 * GB)
    assert within(14, footprint=heavy) == Economy(host_texts=True)


def test_nothing_changes_the_result_unless_nothing_else_fits() -> None:
    choices = [within(limit / 10) for limit in range(38, 160)]
    assert {choice.tiny for choice in choices[:8]} == {"madebyollin/taesd"}
    assert not any(choice.tiny for choice in choices[20:])
    alone = dataclasses.replace(PAINT, tiny="")
    with pytest.raises(PriorError, match="does not fit into 4 GB"):
        within(4, budget=alone)


def test_what_would_do_is_named_and_does() -> None:
    with pytest.raises(PriorError, match=r"does not fit into 3 GB.*--memory 3\.\d or more") as caught:
        within(3)
    assert caught.value.code == "prior.memory"
    within(float(caught.value.hint.split()[2]))


def test_what_was_asked_for_stays() -> None:
    assert within(16, Economy(recompute=2, chunk=2)) == Economy(recompute=2, chunk=2)
    with pytest.raises(PriorError):
        within(8, Economy(recompute=4), budget=dataclasses.replace(PAINT, tiny=""))  # four views' activations at once


def test_a_compiled_network_keeps_its_graphs_memory() -> None:
    compiled = Economy(compile=True)
    assert estimate(SD21, PAINT, compiled) > estimate(SD21, PAINT, Economy())
    assert within(6, compiled).compile is False, "weights that come and go cannot be in a CUDA graph"


def test_on_a_cpu_the_host_is_no_way_out() -> None:
    cpu = dataclasses.replace(PAINT, device="cpu", tiny="")
    choice = within(8, budget=cpu)
    assert not choice.offload
    assert not choice.host_texts
    with pytest.raises(PriorError):
        within(6, budget=cpu)


@pytest.mark.parametrize(
    ("changes", "device", "wanted"),
    [
        ({}, "cpu", Economy()),
        ({}, "cuda:1", Economy(channels_last=True)),
        ({"optim.steps": COMPILE_STEPS}, "cuda", Economy(channels_last=True, compile=True)),
        ({"optim.steps": COMPILE_STEPS}, "cpu", Economy()),
        ({"optim.steps": COMPILE_STEPS, "compute.compile": "off"}, "cuda", Economy(channels_last=True)),
        ({"compute.compile": "on"}, "cpu", Economy(compile=True)),
        ({"device": "cuda:0,cuda:1"}, "cuda:0", Economy(channels_last=True, graphs=False)),
        (
            {"optim.steps": COMPILE_STEPS, "compute.offload": True},
            "cuda",
            Economy(channels_last=True, offload=True),
        ),
        ({"compute.offload": True}, "cpu", Economy()),
        ({"compute.chunk": 2, "compute.recompute": 1}, "cpu", Economy(chunk=2, recompute=1)),
        ({"compute.tiny_vae": "auto"}, "cpu", Economy(tiny="auto")),
    ],
)
def test_as_the_settings_say(changes: dict[str, object], device: str, wanted: Economy) -> None:
    assert Economy.of(merge(PAPER, changes), device) == wanted


def test_several_devices_share_the_views() -> None:
    assert Budget.of(merge(PAPER, {"device": "cuda:0,cuda:1,cuda:2"}), "cuda:0") == Budget(0, 2, 4, "cuda")


def test_a_budget_counts_what_goes_through_the_network() -> None:
    assert Budget.of(PAPER, "cuda:0") == Budget(0, 4, 8, "cuda")
    config = merge(PAPER, {"compute.memory": 8, "guidance.perp_neg": True})
    assert Budget.of(config, "cpu") == Budget(8 * GB, 4, 12, "cpu")
    projects: PaintConfig = merge(PAPER, {"method": "projection"})
    assert Budget.of(projects, "cpu") == Budget(0, 1, 2, "cpu")
