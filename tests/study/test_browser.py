"""The page as people use it: a real Chromium rates a whole round, by mouse and keys; the server is killed between."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image
from tests.judges.viewers import BROWSERS, browser
from tests.study.conftest import METHODS, PROMPTS, Served, shade

from paintit.cli.main import main
from paintit.study.answers import read_answers

if TYPE_CHECKING:
    from playwright.sync_api import Browser, FloatRect, Locator, Page, Response

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install 'paintit[dev]'")
pytestmark = pytest.mark.skipif(browser() is None, reason=f"needs one of {', '.join(BROWSERS)}")

#: What the browser's rater thinks: question -> method -> score.
OPINIONS = {
    "cup": dict(zip(METHODS, (5, 2, 1), strict=True)),
    "hat": dict(zip(METHODS, (4, 3, 1), strict=True)),
    "shoe": dict(zip(METHODS, (5, 3, 2), strict=True)),
}


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=browser(), args=["--no-sandbox"])
        yield window
        window.close()


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    """In a profile of its own."""
    context = chromium.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.set_default_timeout(15000)
    playwright.expect.set_options(timeout=15000)
    yield page
    context.close()


def methods_on(page: Page, question: int) -> list[str]:
    """The methods as they stand on the page, known by the colours of their pictures alone."""
    page.wait_for_url(f"**/{question + 1}")  # and for the last of its pictures
    found = []
    for picture in page.locator("fieldset img").all():
        body = page.request.get(page.url.split("/rate")[0] + (picture.get_attribute("src") or "")).body()
        with Image.open(BytesIO(body)) as image:
            assert "Software" not in image.info
            middle = image.convert("RGB").getpixel((32, 32))
        found.append(METHODS[[shade(i, question) for i in range(len(METHODS))].index(middle)])  # type: ignore[arg-type]
    return found


def rate(page: Page, question: int, by: Callable[[Locator, int], None]) -> list[str]:
    """Rate every picture of the question as ``OPINIONS`` has it; the methods in the order shown."""
    shown = methods_on(page, question)
    for place, method in enumerate(shown):
        with page.expect_response(lambda answer: answer.request.method == "POST"):
            by(page.locator("fieldset").nth(place), OPINIONS[list(PROMPTS)[question]][method])
    playwright.expect(page.locator("#state")).to_have_text("3 of 3 rated, saved")
    return shown


def click(picture: Locator, score: int) -> None:
    picture.locator("label").nth(score - 1).click()


def press(picture: Locator, score: int) -> None:
    picture.locator("input").first.focus()
    picture.page.keyboard.press(str(score))


def test_a_whole_round_and_its_report(
    served: Served, page: Page, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answered: list[Response] = []
    faults: list[str] = []
    page.on("response", lambda answer: answered.append(answer))
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(served.url)
    page.get_by_role("button", name="Begin").click()
    orders, received = [], ""
    for question, prompt in enumerate(PROMPTS.values()):
        page.wait_for_url(f"**/{question + 1}")
        assert prompt in page.locator("h1").inner_text()
        assert page.locator(".bare img").is_visible()
        assert page.locator("img").evaluate_all("images => images.every(i => i.complete && i.naturalWidth == 64)")
        orders.append(rate(page, question, press if question == 1 else click))
        received += page.content()
        page.get_by_role("button", name=re.compile("Next|Finish")).click()
    playwright.expect(page.locator("h1")).to_have_text("Thank you")
    assert sorted(orders[0]) == sorted(METHODS)
    assert len(set(map(tuple, orders))) > 1, "the order never changed"
    received += "".join(answer.url + str(answer.headers) for answer in answered)
    assert not [method for method in METHODS if method in received]
    assert max(answer.status for answer in answered) < 400
    assert faults == []

    out, _, code = served.stop()
    assert (out, code) == (f"{tmp_path / 'answers.sqlite'}\n", 0)
    capsys.readouterr()
    assert main(["study", "report", str(tmp_path / "answers.sqlite"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)["data"]
    # Means by hand: (5 + 4 + 5) / 3, (2 + 3 + 3) / 3, (1 + 1 + 2) / 3.
    assert {o["method"]: o["mean"] for o in report["opinions"]} == pytest.approx(
        {METHODS[0]: 14 / 3, METHODS[1]: 8 / 3, METHODS[2]: 4 / 3}
    )
    assert report["opinions"][0]["counts"] == [0, 0, 0, 1, 2]
    assert (report["raters"], report["complete"], report["answers"], report["unfinished"]) == (1, 1, 9, [])


def test_a_killed_server_loses_no_answer(served: Served, study: Path, page: Page, tmp_path: Path) -> None:
    answers = tmp_path / "answers.sqlite"
    page.goto(served.url)
    page.get_by_role("button", name="Begin").click()
    rate(page, 0, click)
    page.get_by_role("button", name="Next").click()
    shown = methods_on(page, 1)
    with page.expect_response(lambda answer: answer.request.method == "POST"):
        click(page.locator("fieldset").nth(0), OPINIONS["hat"][shown[0]])
    served.kill()
    click(page.locator("fieldset").nth(1), OPINIONS["hat"][shown[1]])
    playwright.expect(page.locator("#state")).to_contain_text("Not saved")
    page.get_by_role("button", name="Next").click()
    assert page.url.endswith("/2"), "the page must not be left while a rating is unsaved"
    kept = {(a.question, a.method): a.score for a in read_answers(answers).answers}
    assert kept == {**{("cup", m): s for m, s in OPINIONS["cup"].items()}, ("hat", shown[0]): OPINIONS["hat"][shown[0]]}

    again = Served(study, answers, served.port)
    try:
        playwright.expect(page.locator("#state")).to_have_text("2 of 3 rated, saved")  # the page tried again by itself
        page.goto(again.url)
        assert "1 of 3 done" in page.locator("main").inner_text()
        page.get_by_role("link", name="Carry on").click()
        assert methods_on(page, 1) == shown  # the same question, in the same order
        assert page.locator("input:checked").count() == 2
        click(page.locator("fieldset").nth(2), OPINIONS["hat"][shown[2]])
        playwright.expect(page.locator("#state")).to_have_text("3 of 3 rated, saved")
        page.get_by_role("button", name="Next").click()
        rate(page, 2, click)
        page.get_by_role("button", name="Finish").click()
        playwright.expect(page.locator("h1")).to_have_text("Thank you")
    finally:
        again.kill()
    kept = {(a.question, a.method): a.score for a in read_answers(answers).answers}
    assert kept == {(q, m): score for q, given in OPINIONS.items() for m, score in given.items()}


def test_it_works_without_javascript(chromium: Browser, served: Served, tmp_path: Path) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(served.url)
    page.get_by_role("button", name="Begin").click()
    for number in range(1, len(PROMPTS) + 1):
        page.wait_for_url(f"**/{number}")
        for picture in page.locator("fieldset").all():
            click(picture, 3)
        page.locator("footer button").click()
    playwright.expect(page.locator("h1")).to_have_text("Thank you")
    context.close()
    assert len(read_answers(tmp_path / "answers.sqlite").answers) == 9


def test_everything_can_be_read_and_reached(served: Served, page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(served.url)
    page.get_by_role("button", name="Begin").click()
    page.wait_for_url("**/1")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    names = page.locator("input").evaluate_all("all => all.map(i => i.labels[0].textContent.trim())")
    assert names[:5] == ["1, very unrealistic", "2, unrealistic", "3, neutral", "4, realistic", "5, very realistic"]
    assert all(box["height"] >= 44 and box["width"] >= 44 for box in map(_box, page.locator(".scores label").all()))
    assert all(image.get_attribute("alt") for image in page.locator("img").all())
    page.get_by_role("button", name="Next").click()
    assert page.url.endswith("/1"), "an unanswered question must not be passed"


def _box(item: Locator) -> FloatRect:
    box = item.bounding_box()
    assert box is not None
    return box
