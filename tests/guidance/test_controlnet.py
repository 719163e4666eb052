"""ControlNets on small random weights of the real class, held to diffusers' own ControlNet pipelines."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.guidance.contract import check_prior, make_channels
from tests.guidance.fake_hub import COMMIT, FakeHub
from tests.guidance.pipeline_step import guided_noise, pipeline_steps
from tests.guidance.tiny import save_tiny, save_tiny_controlnet, save_tiny_sdxl
from torch import Tensor

from paintit.api import load_mesh
from paintit.cli.main import main
from paintit.config import POCKET
from paintit.control import Control
from paintit.errors import PriorError, UsageError
from paintit.guidance.controlnet import depth_picture, normal_picture, weigh
from paintit.guidance.ddpm import DdpmPrior
from paintit.guidance.economy import Economy
from paintit.guidance.known import known_priors
from paintit.guidance.load import controls_for, load_prior, plan_download
from paintit.guidance.loading import Loading
from paintit.guidance.prior import Paced
from paintit.guidance.replicas import Replicas
from paintit.paint.make import make_painter
from paintit.settings import merge

pytest.importorskip("diffusers")
SAVE = {"sd": save_tiny, "sdxl": save_tiny_sdxl}
PIPELINES = {"sd": "StableDiffusionControlNetPipeline", "sdxl": "StableDiffusionXLControlNetPipeline"}


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A tiny checkpoint of each family, and two ControlNets for each: ``sd``, ``sd-depth``, ``sd-normal``, ..."""
    folder = tmp_path_factory.mktemp("control")
    found: dict[str, Path] = {}
    for family, save in SAVE.items():
        found[family] = save(folder / family)
        for seed, kind in enumerate(("depth", "normal")):
            name = f"{family}-{kind}"
            found[name] = save_tiny_controlnet(folder / name, found[family], seed)
    return found


def controlled(
    saved: dict[str, Path], family: str = "sd", *kinds: str, scale: float = 0.8, end: float = 0.0, chunk: int = 0
) -> DdpmPrior:
    controls = tuple(Control(kind, scale / (1 + i), str(saved[f"{family}-{kind}"])) for i, kind in enumerate(kinds))
    prior = load_prior(str(saved[family]), Loading(control=controls, control_end=end, economy=Economy(chunk=chunk)))
    assert isinstance(prior, DdpmPrior)
    return prior


def asked(prior: DdpmPrior, count: int = 2, size: int = 32) -> tuple[Tensor, Tensor, Tensor]:
    """x_t, text and geometry of some views."""
    x_t = torch.randn(count, 4, 16, 16, generator=torch.Generator().manual_seed(0))
    geometry = prior.encode_geometry(make_channels(prior.sees, count, size, seed=3))
    assert geometry is not None
    return x_t, prior.encode_text(["a red cow", "blue", "c", "d", "e"][:count]), geometry


@pytest.mark.parametrize("family", ["sd", "sdxl"])
def test_contract(saved: dict[str, Path], family: str) -> None:
    prior = controlled(saved, family, "depth", "normal")
    check_prior(prior)
    assert prior.sees == ("depth", "normal", "mask")
    assert controlled(saved, family, "normal").sees == ("normal", "mask")
    assert controlled(saved, family).sees == ()


@pytest.mark.parametrize("kinds", [("depth",), ("normal", "depth")])
@pytest.mark.parametrize("family", ["sd", "sdxl"])
def test_guided_prediction_is_the_pipelines(saved: dict[str, Path], family: str, kinds: Sequence[str]) -> None:
    """Two steps of diffusers' pipeline, shown the same pictures: the same guidance. Two ControlNets add up."""
    import diffusers
    from diffusers.schedulers.scheduling_ddim import DDIMScheduler

    prior = controlled(saved, family, *kinds)
    assert prior.controls is not None
    x, text, geometry = asked(prior)
    nets = list(prior.controls.nets)
    scheduler = DDIMScheduler.from_config(prior.pipe.scheduler.config, clip_sample=False)
    parts = {**prior.pipe.components, "controlnet": nets if len(nets) > 1 else nets[0], "scheduler": scheduler}
    if family == "sd":
        parts["requires_safety_checker"] = False
    pipeline: Any = getattr(diffusers, PIPELINES[family])(**parts)
    shown, scales = list(geometry.chunk(len(nets), 1)), [control.scale for control in prior.controls.controls]
    options: dict[str, Any] = {
        "image": shown if len(nets) > 1 else shown[0],
        "controlnet_conditioning_scale": scales if len(nets) > 1 else scales[0],
        "negative_prompt": ["ugly", "ugly"],
        "num_inference_steps": 2,
        "guidance_scale": 7.5,
        "latents": x,
        "output_type": "latent",
    }
    steps = pipeline_steps(pipeline, lambda: pipeline(["a red cow", "blue"], **options))
    plain = controlled(saved, family)
    assert len(steps) == 2
    for step in steps:
        t = step.timestep / 1000
        ours = guided_noise(prior, step.x_t, t, text, prior.encode_text(["ugly"]), 7.5, geometry)
        torch.testing.assert_close(ours, step.guided, atol=1e-4, rtol=0)
        without = guided_noise(plain, step.x_t, t, text, plain.encode_text(["ugly"]), 7.5)
        assert (without - step.guided).abs().max() > 0.02, "the ControlNets do something"


def test_scale_0_is_no_control(saved: dict[str, Path]) -> None:
    prior, plain = controlled(saved, "sd", "depth", scale=0.0), controlled(saved)
    x_t, text, geometry = asked(prior)
    torch.testing.assert_close(
        prior.predict_noise(x_t, 0.5, text, geometry), plain.predict_noise(x_t, 0.5, text), atol=1e-6, rtol=0
    )


def test_scale_falls_over_the_paint(saved: dict[str, Path]) -> None:
    """At half of it, with 0.2 left at the end, it is 0.6 of what it was; asked again for the start, it is whole."""
    prior, other = controlled(saved, "sd", "depth", scale=0.5, end=0.2), controlled(saved, "sd", "depth", scale=0.3)
    assert isinstance(prior, Paced)
    x_t, text, geometry = asked(prior)
    whole = prior.predict_noise(x_t, 0.5, text, geometry)
    prior.pace(0.5)
    half = prior.predict_noise(x_t, 0.5, text, geometry)
    torch.testing.assert_close(half, other.predict_noise(x_t, 0.5, text, geometry))
    assert not torch.allclose(half, whole, atol=1e-3)
    prior.pace(0.0)
    assert torch.equal(prior.predict_noise(x_t, 0.5, text, geometry), whole)


@pytest.mark.parametrize("family", ["sd", "sdxl"])
def test_chunks_change_nothing(saved: dict[str, Path], family: str) -> None:
    whole, chunked = (controlled(saved, family, "depth", "normal", chunk=chunk) for chunk in (0, 2))
    x_t, text, geometry = asked(whole, 5)
    expected = whole.predict_noise(x_t, 0.4, text, geometry)
    assert chunked.controls is not None
    sizes: list[int] = []
    hook = chunked.controls.nets[1].register_forward_pre_hook(lambda _, args: sizes.append(len(args[0])))
    torch.testing.assert_close(chunked.predict_noise(x_t, 0.4, text, geometry), expected, atol=1e-5, rtol=1e-4)
    hook.remove()
    assert sizes == [2, 2, 1]


def test_low_precision_is_near(saved: dict[str, Path]) -> None:
    control = (Control("depth", 0.8, str(saved["sdxl-depth"])),)
    full, low = (load_prior(str(saved["sdxl"]), Loading(control=control, dtype=d)) for d in ("float32", "bfloat16"))
    assert isinstance(full, DdpmPrior)
    assert isinstance(low, DdpmPrior)
    assert low.controls is not None
    assert next(low.controls.nets.parameters()).dtype == torch.bfloat16
    x_t, text, geometry = asked(full)
    expected = full.predict_noise(x_t, 0.5, text, geometry)
    got = low.predict_noise(x_t, 0.5, low.encode_text(["a red cow", "blue"]), geometry)
    assert got.dtype == torch.float32
    assert (got - expected).norm() < 0.03 * expected.norm()


def test_the_memory_of_the_weights_is_counted(saved: dict[str, Path]) -> None:
    prior = controlled(saved, "sd", "depth", "normal")
    assert prior.controls is not None
    count = sum(weight.numel() for weight in prior.controls.nets.parameters())
    controls = prior.controls.controls
    assert weigh(Loading(control=controls)) == 4 * count
    assert weigh(Loading(control=controls, dtype="bfloat16")) == 2 * count
    assert weigh(Loading()) == 0


def test_replicas_keep_the_same_pace(saved: dict[str, Path]) -> None:
    one = controlled(saved, "sd", "depth", end=0.5)
    copies = [controlled(saved, "sd", "depth", end=0.5) for _ in range(2)]
    both = Replicas(copies, ["cpu", "cpu"])
    assert isinstance(both, Paced)
    assert both.sees == ("depth", "mask")
    one.pace(0.8)
    both.pace(0.8)
    x_t, text, geometry = asked(one, 3)
    expected = one.predict_noise(x_t, 0.5, text, geometry)
    torch.testing.assert_close(both.predict_noise(x_t, 0.5, text, geometry), expected, atol=1e-5, rtol=1e-4)


def test_depth_is_shown_as_midas_would() -> None:
    """Nearest white, farthest mid-grey, black behind; inverse depth between; three equal channels."""
    depth = torch.tensor([2.0, 8 / 3, 4.0, 0.0]).repeat_interleave(8)[None, None, :, None].expand(1, 32, 32, 1)
    shown = depth_picture(depth, (depth > 0).float(), 32)
    assert shown.shape == (1, 3, 32, 32)
    torch.testing.assert_close(shown[0, 0, 5, ::8], torch.tensor([1.0, 0.75, 0.5, 0.0]))
    assert torch.equal(shown[:, 0], shown[:, 1])
    assert torch.equal(shown[:, 0], shown[:, 2])


def test_normals_are_shown_as_bae_would() -> None:
    """Blue is front, red is left, green is top (the ControlNet authors' words); behind is a wall facing the camera."""
    left, up, front = torch.tensor([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    rows = torch.stack([left, up, front, torch.zeros(3)]).repeat_interleave(8, 0)
    normal = rows[None, None].expand(1, 32, 32, 3)
    shown = normal_picture(normal, (normal.norm(dim=-1, keepdim=True) > 0).float(), 32)
    expected = torch.tensor([[1.0, 0.5, 0.5], [0.5, 1.0, 0.5], [0.5, 0.5, 1.0], [0.5, 0.5, 1.0]])
    torch.testing.assert_close(shown[0, :, 7, ::8].T, expected)
    assert normal_picture(normal, normal[..., :1], 16).shape == (1, 3, 16, 16)


@pytest.mark.parametrize(("text", "control"), [
    ("depth", Control("depth", 1.0, "")),
    ("normal:0.5", Control("normal", 0.5, "")),
    ("depth=own/net:0.8", Control("depth", 0.8, "own/net")),
    ("depth=own/net", Control("depth", 1.0, "own/net")),
    (r"depth=C:\nets\mine", Control("depth", 1.0, r"C:\nets\mine")),
    ("normal=a=b:0", Control("normal", 0.0, "a=b")),
])  # fmt: skip
def test_spelling(text: str, control: Control) -> None:
    assert Control.parse(text) == control


@pytest.mark.parametrize("text", ["", "dept", "depth:", "depth:x", "depth=", "depth:-1", "depth:nan", "depth:11", ":1"])
def test_bad_spelling(text: str) -> None:
    with pytest.raises(UsageError) as caught:
        Control.parse(text)
    assert caught.value.hint
    assert f'"{text}"' in caught.value.message


def refusal(prior: str | Path, *controls: Control, **options: Any) -> PriorError:
    with pytest.raises(PriorError) as caught:
        load_prior(str(prior), Loading(control=controls, **options))
    assert caught.value.hint
    assert "\n" not in str(caught.value)
    return caught.value


def test_priors_that_take_none(saved: dict[str, Path], tmp_path: Path) -> None:
    assert "'pocket' takes no ControlNet" in refusal("pocket", Control("depth")).message
    for name in ("klein", "deepfloyd-if"):
        assert refusal(name, Control("depth")).message.startswith(f"'{name}', of "), "before anything is fetched"
    depth = save_tiny(tmp_path / "depth", depth=True)
    net = save_tiny_controlnet(tmp_path / "net", saved["sd"])
    assert "sees depth by itself" in refusal(depth, Control("depth", model=str(net))).message


def test_which_belongs_to_a_known_prior(saved: dict[str, Path]) -> None:
    assert {name: set(info.control) for name, info in known_priors().items() if info.control} == {
        "sd21-base": {"depth", "normal"}, "sd21": {"depth", "normal"}, "sd15": {"depth", "normal"}, "sdxl": {"depth"},
    }  # fmt: skip
    own = "lllyasviel/control_v11f1p_sd15_depth"
    for name in ("sd15", "stable-diffusion-v1-5/stable-diffusion-v1-5"):
        assert controls_for(name, [Control("depth", 0.5)]) == (Control("depth", 0.5, own),)
    mine = Control("normal", 0.5, "my/net")
    assert controls_for("sdxl", [mine]) == (mine,)
    with pytest.raises(PriorError, match="no ControlNet for normal is known for 'sdxl'; known for it: depth") as caught:
        controls_for("sdxl", [Control("normal")])
    assert "--control normal=FOLDER_OR_ID" in caught.value.hint
    error = refusal(saved["sd"], Control("depth"))
    assert f"no ControlNet for depth is known for '{saved['sd']}'" in error.message


@pytest.mark.parametrize(("change", "words"), [
    ({"cross_attention_dim": 768}, "cross_attention_dim is 768, not 16"),
    ({"block_out_channels": [8, 32]}, r"block_out_channels is [8, 32], not [8, 16]"),
    ({"in_channels": 9}, "in_channels is 9, not 4"),
    ({"addition_embed_type": "text_time"}, "addition_embed_type is text_time, not None"),
    ({"conditioning_channels": 1}, "conditioning_channels is 1, not 3"),
    ({"conditioning_embedding_out_channels": [16, 32, 96, 256]}, "pixels per latent is 8, not 2"),
    ({"_class_name": "ControlNetUnionModel"}, "is a ControlNetUnionModel"),
    ({"_class_name": "UNet2DConditionModel"}, "is a UNet2DConditionModel"),
])  # fmt: skip
def test_a_net_of_another_make(saved: dict[str, Path], tmp_path: Path, change: dict[str, Any], words: str) -> None:
    net = Path(shutil.copytree(saved["sd-depth"], tmp_path / "net"))
    config = json.loads((net / "config.json").read_text())
    (net / "config.json").write_text(json.dumps(config | change))
    error = refusal(saved["sd"], Control("depth", model=str(net)))
    assert words in error.message
    assert str(net) in error.message


def test_a_net_for_another_family(saved: dict[str, Path]) -> None:
    assert "does not fit" in refusal(saved["sdxl"], Control("depth", model=str(saved["sd-depth"]))).message
    assert "does not fit" in refusal(saved["sd"], Control("depth", model=str(saved["sdxl-depth"]))).message


def test_broken_folders(saved: dict[str, Path], tmp_path: Path) -> None:
    net = Path(shutil.copytree(saved["sd-depth"], tmp_path / "net"))
    control = Control("depth", model=str(net))
    weights = net / "diffusion_pytorch_model.safetensors"
    whole = weights.read_bytes()
    weights.write_bytes(whole[: len(whole) // 2])
    assert "the network of" in refusal(saved["sd"], control).message
    weights.unlink()
    assert "has no weights for its network" in refusal(saved["sd"], control).message
    (net / "diffusion_pytorch_model.bin").write_bytes(b"pickle")
    assert refusal(saved["sd"], control).code == "prior.pickle"
    (net / "config.json").unlink()
    assert "has no config.json" in refusal(saved["sd"], control).message
    assert refusal(saved["sd"], Control("depth", model=str(tmp_path / "none"))).code == "prior.missing"
    assert "not a prior" in refusal(saved["sd-depth"]).message


def test_from_the_hub(saved: dict[str, Path], hub: FakeHub, caplog: pytest.LogCaptureFixture) -> None:
    """Not fetched unasked; then its two files alone, the licence said before; then from the cache."""
    hub.folders["some/net"] = saved["sd-depth"]
    control = Control("depth", 0.7, "some/net")
    error = refusal(saved["sd"], control)
    assert error.code == "prior.not_cached"
    assert "paintit priors pull some/net" in error.hint
    assert not hub.fetched
    assert list(plan_download("some/net").sizes) == ["config.json", "diffusion_pytorch_model.safetensors"]
    hub.requests.clear()
    prior = load_prior(str(saved["sd"]), Loading(control=(control,), allow_download=True))
    assert set(hub.fetched) == {"config.json", "diffusion_pytorch_model.safetensors"} - {"config.json"}
    assert "licence: test-licence" in caplog.text
    assert prior.spec.added == (f"depth control 0.7: some/net ({COMMIT})",)
    hub.requests.clear()
    load_prior(str(saved["sd"]), Loading(control=(control,)))
    assert not hub.requests
    assert "not a prior" in refusal("some/net").message
    assert refusal(saved["sd"], Control("depth", model="gone/net"), allow_download=True).code == "prior.withdrawn"


SPOT = Path(__file__).parents[2] / "assets" / "meshes" / "spot" / "spot.obj"
TINY = ["--texture-size", "32", "--texture.widths", "8", "8", "--texture.skip-widths", "4", "4",
        "--views", "2", "--render-size", "32", "--preview", "none", "--json"]  # fmt: skip


@pytest.mark.parametrize("method", ["distillation", "projection"])
def test_paint(saved: dict[str, Path], tmp_path: Path, method: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Whole, with both controls; the record says which, without telling a folder."""
    controls = [f"--control={kind}={saved[f'sd-{kind}']}:0.8" for kind in ("depth", "normal")]
    steps = ["--steps", "3", "--projection.views", "2", "--projection.steps", "2", "--method", method]
    command = ["paint", str(SPOT), "a red cow", "--prior", str(saved["sd"]), *controls, *steps, *TINY]
    assert main([*command, "-o", str(tmp_path / "a.glb")]) == 0
    run = Path(json.loads(capsys.readouterr().out)["data"]["run"])
    record = json.loads((run / "run.json").read_text())
    assert [text.partition(" (")[0] for text in record["prior"]["added"]] == [
        "depth control 0.8: sd-depth", "normal control 0.8: sd-normal",
    ]  # fmt: skip
    assert record["config"]["guidance"]["control"] == ["depth=sd-depth:0.8", "normal=sd-normal:0.8"]
    assert str(saved["sd"].parent) not in json.dumps(record), "no folder of this machine is told"
    assert main(["paint", "--resume", str(run)]) == 0


def test_a_resumed_paint_has_the_scales_of_one_that_was_not_stopped(saved: dict[str, Path]) -> None:
    """Another process's prior has paced nothing before; its third step is the third step all the same."""
    settings = {"texture.size": 32, "texture.upsample": 1, "texture.widths": [8, 8], "texture.skip_widths": [4, 4],
                "views.count": 2, "views.size": 32, "optim.steps": 4, "guidance.prior": str(saved["sd"]),
                "guidance.control": [f"depth={saved['sd-depth']}"]}  # fmt: skip
    mesh, config = load_mesh(SPOT), merge(POCKET, settings)
    whole, first, second = (make_painter(mesh, "a red cow", config) for _ in range(3))
    assert len(list(whole)) == 4
    assert isinstance(whole.prior, DdpmPrior)
    assert whole.prior.controls is not None
    assert whole.prior.controls.share == 0, "of the last step"
    assert len(list(itertools.islice(first, 2))) == 2
    second.load_state_dict(first.state_dict())
    assert len(list(second)) == 2
    assert torch.equal(whole.maps().packed(), second.maps().packed())


def test_command_line_errors(saved: dict[str, Path], capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, words in (
        (["--control", "dept"], 'guidance.control is "dept"'),
        (["--control", "depth", "--control", "depth:0.5"], "name depth once"),
        (["--control", "depth"], "'pocket' takes no ControlNet"),
        (["--control", "normal", "--prior", "sdxl", "--dry-run"], "no ControlNet for normal is known for 'sdxl'"),
        (["--control", "depth", "--guidance.control-end", "2"], "guidance.control_end is 2.0"),
        (["--control", f"depth={saved['sd-depth']}:x", "--prior", str(saved["sd"])], "SCALE"),
        (["--control", f"depth={saved['sdxl-depth']}", "--prior", str(saved["sd"])], "does not fit"),
        (["--control", "depth=no/such", "--prior", str(saved["sd"])], "'no/such' is not on this machine"),
    ):
        assert main(["paint", str(SPOT), "x", *arguments]) in (1, 2)
        captured = capsys.readouterr()
        assert captured.out == ""
        assert words in captured.err
        assert captured.err.count("\n") == 1
