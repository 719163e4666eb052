"""The page over plain HTTP: what it refuses, what it keeps, what it never says."""

from __future__ import annotations

import http.client
import socket
import sqlite3
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlencode

import pytest
from tests.cli.conftest import Ran
from tests.study.conftest import METHODS, Served

from paintit.study.answers import read_answers
from paintit.study.questions import order, read_study


def ask(
    served: Served, method: str, path: str, body: bytes | dict[str, object] | None = None, **headers: str
) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of one answer, without following it."""
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=20)
    data = urlencode(body).encode() if isinstance(body, dict) else body
    kind = {"Content-Type": "application/x-www-form-urlencoded"} if data is not None else {}
    connection.request(method, path, data, {**kind, **headers})
    answer = connection.getresponse()
    found = answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    connection.close()
    return found


def begin(served: Served) -> str:
    """The address of a new rater, up to the number of the question."""
    status, headers, _ = ask(served, "POST", "/begin")
    assert status == 303
    assert "HttpOnly" in headers["set-cookie"]
    return headers["location"].removesuffix("/1")


def kept(tmp_path: Path) -> dict[tuple[int, str, str], int]:
    return {(a.rater, a.question, a.method): a.score for a in read_answers(tmp_path / "answers.sqlite").answers}


def test_what_is_not_an_answer_is_refused_and_nothing_is_written(served: Served, tmp_path: Path) -> None:
    home = begin(served)
    good: dict[str, object] = {"place-1": 3}
    for status, path, body, headers in [
        (400, f"{home}/1", {"place-1": 0}, {}),
        (400, f"{home}/1", {"place-1": 6}, {}),
        (400, f"{home}/1", {"place-1": "3.0"}, {}),
        (400, f"{home}/1", {"place-1": ""}, {}),
        (400, f"{home}/1", {"place-1": "٣"}, {}),
        (400, f"{home}/1", {"place-1": 3, "place-2": "very"}, {}),
        (400, f"{home}/1", {"place-4": 3}, {}),
        (400, f"{home}/1", {"place-0": 3}, {}),
        (400, f"{home}/1", {"score": 3}, {}),
        (400, f"{home}/1", b"place-1=3&place-1=4", {}),
        (400, f"{home}/1", b"place-1", {}),
        (400, f"{home}/1", b"\xff\xfe=3", {}),
        (413, f"{home}/1", b"place-1=3&" + b"x" * 20000, {}),
        (404, f"{home}/0", good, {}),
        (404, f"{home}/4", good, {}),
        (404, f"{home}/x", good, {}),
        (404, "/rate/nobody/1", good, {}),
        (403, f"{home}/1", good, {"Origin": "http://elsewhere.example"}),
        (403, "/begin", b"", {"Origin": "null"}),
        (400, f"{home}/1", good, {"Host": "elsewhere.example"}),
        (405, "/picture/x", good, {}),
    ]:  # fmt: skip
        assert ask(served, "POST", path, body, **headers)[0] == status, (path, body, headers)
        assert kept(tmp_path) == {}
    for path in ("/picture/nothing", "/picture/..%2f..%2fstudy.toml", "/static/../base.html", "/rate/nobody", "/none"):
        assert ask(served, "GET", path)[0] == 404, path
    assert ask(served, "POST", f"{home}/1", good)[0] == 303
    assert list(kept(tmp_path).values()) == [3]


def test_an_answer_said_twice_is_kept_once_and_a_changed_mind_replaces_it(served: Served, tmp_path: Path) -> None:
    home = begin(served)
    for scores in ((4, 1), (4, 1), (2, 1)):
        body: dict[str, object] = {"place-1": scores[0], "place-2": scores[1]}
        assert ask(served, "POST", f"{home}/2", body, Accept="application/json")[0] == 204
        assert sorted(kept(tmp_path).values()) == sorted(scores)
    assert ask(served, "GET", home)[1]["location"] == f"{home}/1"
    assert ask(served, "POST", f"{home}/2", {"place-3": 5})[1]["location"] == f"{home}/3"
    assert sorted(kept(tmp_path).values()) == [1, 2, 5]


def test_two_raters_do_not_meet(served: Served, tmp_path: Path) -> None:
    first, second = begin(served), begin(served)
    ask(served, "POST", f"{first}/1", {"place-1": 1})
    ask(served, "POST", f"{second}/1", {"place-1": 5})
    assert sorted((rater, score) for (rater, _, _), score in kept(tmp_path).items()) == [(1, 1), (2, 5)]
    with sqlite3.connect(tmp_path / "answers.sqlite") as file:
        rows = file.execute("SELECT raters.seed, method, place FROM answers JOIN raters ON number = rater").fetchall()
        assert file.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    file.close()
    assert len({seed for seed, *_ in rows}) == 2
    for seed, method, place in rows:
        assert order(seed, 0, METHODS)[place] == method


def test_pages_forbid_what_they_do_not_need(served: Served) -> None:
    for path in ("/", f"{begin(served)}/1", "/none"):
        _, headers, body = ask(served, "GET", path)
        assert "default-src 'self'" in headers["content-security-policy"]
        assert (headers["x-content-type-options"], headers["cache-control"]) == ("nosniff", "no-store")
        assert b"http://" not in body.replace(b"http://www.w3.org", b"")
        assert b"https://" not in body


def test_the_prompt_is_text_and_not_markup(served: Served) -> None:
    home = begin(served)
    assert b"a blue &amp; white cup" in ask(served, "GET", f"{home}/1")[2]
    assert b"a &lt;straw&gt; hat" in ask(served, "GET", f"{home}/2")[2]


def test_only_this_machine_is_served(served: Served) -> None:
    """The address that the machine has among others does not answer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has no address but loopback")
        address = probe.getsockname()[0]
    if address.startswith("127."):
        pytest.skip("this machine has no address but loopback")
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection((address, served.port), timeout=5)


def test_a_taken_port_is_one_line(served: Served, study: Path, paintit: Callable[..., Ran], tmp_path: Path) -> None:
    ran = paintit("study", "serve", study, "-o", tmp_path / "other.sqlite", "--port", served.port)
    hint = "choose another --port (0 takes any free one) or --host"
    assert ran.errors == [f"error: cannot listen on 127.0.0.1 port {served.port}: address already in use; {hint}"]
    assert ran.code == 1


def test_every_order_comes_about_as_often_as_any_other(study: Path) -> None:
    methods = read_study(study).methods
    firsts = [order(rater, question, methods)[0] for rater in range(300) for question in range(3)]
    assert all(250 < firsts.count(method) < 350 for method in methods)  # 300 expected, standard deviation 14
