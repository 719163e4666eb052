"""``paintit evaluate`` whole: from files to figures, a document and a page."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
import torch
from PIL import Image
from tests.evaluate.conftest import SMALL, faces

from paintit.cli.main import main
from paintit.evaluate import measure
from paintit.evaluate.features import load_network
from paintit.evaluate.measure import Painted, evaluate, reference_of_assets
from paintit.evaluate.page import page
from paintit.evaluate.protocol import pictures
from paintit.export.write import write
from paintit.mesh.mesh import Mesh
from paintit.texture.maps import TextureMaps

Make = Callable[..., TextureMaps]
RED, BLUE = torch.tensor([0.6, 0.05, 0.05]), torch.tensor([0.05, 0.05, 0.6])
#: Flags that keep the commands quick.
QUICK = ["--size", "32", "--relight", "default"]


@pytest.fixture
def folders(tmp_path: Path, sphere: Mesh, painted: Make) -> Path:
    """``good/`` and ``truth/`` hold one red ``ball.glb``, ``bad/`` a blue metal one."""
    looks = {"good": painted(RED), "bad": painted(BLUE, 0.2, 1.0), "truth": painted(RED)}
    for folder, maps in looks.items():
        (tmp_path / folder).mkdir()
        write(tmp_path / folder / "ball.glb", sphere, maps, {})
    return tmp_path


def test_sets_of_files_become_figures_a_document_and_a_page(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = {name: str(folders / name) for name in ("good", "bad", "truth")}
    arguments = ["evaluate", where["good"], where["bad"], "--reference", where["truth"], "--truth", where["truth"]]
    assert main(["--json", *arguments, "-o", str(folders / "report"), *QUICK]) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)["data"]
    good, bad = (each["scores"] for each in data["sets"])
    assert [each["name"] for each in data["sets"]] == ["good", "bad"]
    assert abs(good["fid_pocket"]) < 1e-3 < 1 < bad["fid_pocket"]
    assert good["kid_pocket"] < 0.05 < bad["kid_pocket"]
    assert good["fid_pocket_relit"] < bad["fid_pocket_relit"]
    assert good["delta_e"] < 1e-3 < 20 < bad["delta_e"]
    assert bad["metallic_error"] == pytest.approx(1, abs=0.01)
    assert [(each["set"], each["name"]) for each in data["assets"]] == [("good", "ball"), ("bad", "ball")]
    assert "FID of 20 pictures in 128 dimensions" in err

    written = json.loads((folders / "report" / "evaluate.json").read_text())
    assert written["sets"] == data["sets"]
    assert written["protocol"]["elevations"] == [15, 45]
    text = (folders / "report" / "evaluate.html").read_text()
    assert text.count("data:image/webp") == 8
    assert main([*arguments, "-o", str(folders / "report"), *QUICK]) == 1
    assert "evaluate.json exists; add --overwrite" in capsys.readouterr().err


def test_a_table_has_a_row_for_each_set_and_each_asset(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(folders / "good" / "ball.glb"), *QUICK]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["assets", "seam", "saturation", "flatness", "janus_pocket"]
    assert lines[1].startswith("assets")
    assert lines[-1].startswith("assets/ball ")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "error: no asset is given; write: paintit evaluate PATH --reference FOLDER"),
        (["."], "error: there is no painted asset at .; name runs, .glb or .gltf files"),
        (["x.glb", "--features", "pockte"], "error: there is no feature network 'pockte'; did you mean 'pocket'?"),
        (["x.glb", "--size", "-3"], "error: --size is -3; it must be from 0 to 8192"),
    ],
)
def test_mistakes_are_one_line(
    arguments: list[str], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", *arguments]) == 2
    assert capsys.readouterr().err.splitlines() == [line]


def test_a_folder_of_pictures_is_a_reference(sphere: Mesh, painted: Make, tmp_path: Path) -> None:
    network = load_network("pocket")
    for i, view in enumerate(pictures(sphere, painted(RED), SMALL)):
        Image.fromarray(view).save(tmp_path / f"{i:02d}.png")
    reference = measure.reference_of_pictures(tmp_path, network)
    result = evaluate({"red": [Painted("a", sphere, painted(RED))]}, SMALL, network, reference)
    assert result.sets[0].scores["fid_pocket"] == pytest.approx(0, abs=1e-4)
    assert "fid_pocket_relit" not in result.sets[0].scores
    (tmp_path / "00.png").write_bytes(b"not a picture")
    with pytest.raises(Exception, match="cannot be read as a picture; remove it"):
        measure.reference_of_pictures(tmp_path, network)


class Links(HTMLParser):
    """Collects whatever a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data")]


def test_the_page_holds_all_it_shows(sphere: Mesh, painted: Make) -> None:
    network = load_network("pocket")
    assets = [Painted("<b>", sphere, painted(RED), "a & b"), Painted("blue", sphere, painted(BLUE))]
    reference = reference_of_assets("red", assets[:1], SMALL, network)
    result = evaluate({"one": assets[:1], "two": assets[1:]}, SMALL, network, reference)
    text = page(result, assets)
    links = Links()
    links.feed(text)
    assert len(links.found) == 8
    assert all(link.startswith("data:image/webp;base64,") for link in links.found)
    assert not re.search(r"https?://|@import|url\(", text)
    assert "&lt;b&gt;" in text
    assert "a &amp; b" in text
    # The set that is the reference has the better distance, and is marked.
    row = text[text.index("<th>one</th>") : text.index("<th>two</th>")]
    assert "class=best" in row


def test_scores_are_means_over_those_that_have_them(sphere: Mesh, painted: Make) -> None:
    assets = [Painted("plain", sphere, painted(RED)), Painted("face", sphere, painted(faces(0)))]
    result = evaluate({"both": assets}, replace(SMALL, ring=2), load_network("pocket"))
    plain, face = (asset.scores for asset in result.assets)
    assert plain["janus_pocket"] is None
    assert result.sets[0].scores["janus_pocket"] == face["janus_pocket"]
    assert result.sets[0].scores["saturation"] == pytest.approx(
        ((plain["saturation"] or 0) + (face["saturation"] or 0)) / 2
    )
