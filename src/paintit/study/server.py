"""The page that asks. Plain forms that work without JavaScript, which only adds saving at every click.

Nothing that a browser receives names a method: places are numbered, pictures have keyed names and lose their metadata.
"""

from __future__ import annotations

import hashlib
import hmac
import io
import os
import socket
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import uvicorn
from jinja2 import Environment, PackageLoader
from PIL import Image, ImageOps
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from paintit.errors import StudyError
from paintit.study.answers import Answers, Rater
from paintit.study.questions import SCALE

PAGES = Path(__file__).parent / "pages"
COOKIE = "paintit_rater"
#: Bytes of a form; one of ours has about 20 for each method.
FORM_LIMIT = 16384
#: Hosts by which a server bound to this machine alone may be called; others are a foreign page's trick.
LOOPBACK = ("127.0.0.1", "localhost", "::1", "[::1]")
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'",
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


class Site:
    """The pages of one study. Questions are numbered from 1 in addresses, from 0 in ``Answers``."""

    def __init__(self, answers: Answers) -> None:
        self.answers = answers
        self.study = answers.study
        self._templates = Environment(loader=PackageLoader("paintit.study", "pages"), autoescape=True)
        shown = [p for q in self.study.questions for p in (*q.pictures.values(), q.untextured) if p]
        self._pictures = {self._name(path): path for path in shown}

    def app(self, loopback: bool) -> Starlette:
        """The application; ``loopback`` refuses requests that call this machine by another name."""
        routes = [
            Route("/", self.welcome),
            Route("/begin", self.begin, methods=["POST"]),
            Route("/rate/{token}", self.resume),
            Route("/rate/{token}/{number:int}", self.question),
            Route("/rate/{token}/{number:int}", self.rate, methods=["POST"]),
            Route("/rate/{token}/thanks", self.thanks),
            Route("/picture/{name}", self.picture),
            Mount("/static", StaticFiles(directory=PAGES / "static")),
        ]
        guard = [Middleware(TrustedHostMiddleware, allowed_hosts=list(LOOPBACK))] if loopback else []
        return Starlette(routes=routes, middleware=guard, exception_handlers={HTTPException: self.refuse})

    async def welcome(self, request: Request) -> Response:
        rater = self.answers.rater(request.cookies.get(COOKIE, ""))
        return self._page("welcome.html", rater=rater, given=self._complete(rater) if rater else 0)

    async def begin(self, request: Request) -> Response:
        _check_origin(request)
        rater = self.answers.new_rater()
        answer = RedirectResponse(f"/rate/{rater.token}/1", 303)
        answer.set_cookie(COOKIE, rater.token, max_age=180 * 86400, httponly=True, samesite="strict")
        return answer

    async def resume(self, request: Request) -> Response:
        """To the first question that lacks an answer."""
        rater = self._rater(request)
        scores = self.answers.scores(rater)
        for number, question in enumerate(self.study.questions, 1):
            if len(scores[question.name]) < len(self.study.methods):
                return RedirectResponse(f"/rate/{rater.token}/{number}", 303)
        return RedirectResponse(f"/rate/{rater.token}/thanks", 303)

    async def question(self, request: Request) -> Response:
        rater, index = self._rater(request), self._index(request)
        question = self.study.questions[index]
        scores = self.answers.scores(rater)[question.name]
        places = [
            (self._name(question.pictures[method]), scores.get(method)) for method in self.answers.order(rater, index)
        ]
        bare = self._name(question.untextured) if question.untextured else None
        return self._page("question.html", rater=rater, number=index + 1, question=question, places=places, bare=bare)

    async def rate(self, request: Request) -> Response:
        """Keep what the form says; any part of it, so that each click can be sent at once."""
        _check_origin(request)
        rater, index = self._rater(request), self._index(request)
        scores = _scores(await _form(request), self.answers.order(rater, index))
        self.answers.record(rater, index, scores)
        if "application/json" in request.headers.get("accept", ""):
            return Response(status_code=204)
        if len(self.answers.scores(rater)[self.study.questions[index].name]) < len(self.study.methods):
            return RedirectResponse(f"/rate/{rater.token}/{index + 1}", 303)
        last = index + 1 == len(self.study.questions)
        return RedirectResponse(f"/rate/{rater.token}" + ("" if last else f"/{index + 2}"), 303)

    async def thanks(self, request: Request) -> Response:
        rater = self._rater(request)
        return self._page("thanks.html", rater=rater, given=self._complete(rater))

    def picture(self, request: Request) -> Response:
        path = self._pictures.get(request.path_params["name"])
        if path is None:
            raise HTTPException(404, "There is no such picture.")
        return Response(_bare_png(path), media_type="image/png", headers={"Cache-Control": "private, max-age=86400"})

    async def refuse(self, request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        return self._page("refused.html", error.status_code, message=error.detail)

    def _page(self, name: str, status: int = 200, **values: object) -> Response:
        text = self._templates.get_template(name).render(study=self.study, scale=SCALE, **values)
        return HTMLResponse(text, status, _HEADERS)

    def _rater(self, request: Request) -> Rater:
        rater = self.answers.rater(request.path_params["token"])
        if rater is None:
            raise HTTPException(404, "Nobody has begun under this address.")
        return rater

    def _index(self, request: Request) -> int:
        number = request.path_params["number"]
        if not 1 <= number <= len(self.study.questions):
            raise HTTPException(404, f"There is no question {number}; there are {len(self.study.questions)}.")
        return number - 1

    def _complete(self, rater: Rater) -> int:
        """Questions that ``rater`` has answered wholly."""
        return sum(len(given) == len(self.study.methods) for given in self.answers.scores(rater).values())

    def _name(self, path: Path) -> str:
        return hmac.new(self.answers.key, str(path).encode(), hashlib.sha256).hexdigest()[:32]


def serve(answers: Answers, host: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve until interrupted; ``ready(address)`` is called when the port is ours. Port 0 takes any free one.

    Raises:
        StudyError: the address cannot be had.
    """
    listener = _listen(host, port)
    config = uvicorn.Config(
        Site(answers).app(host in LOOPBACK), log_level="warning", access_log=False, server_header=False,
        timeout_graceful_shutdown=2,
    )  # fmt: skip
    name = f"[{host}]" if ":" in host else host
    with listener:
        ready(f"http://{name}:{listener.getsockname()[1]}/")
        uvicorn.Server(config).run([listener])


def _listen(host: str, port: int) -> socket.socket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        code = error.errno or 0  # negative where the name is not known
        reason = (os.strerror(code) if code > 0 else error.strerror or str(error)).lower()
        raise StudyError(
            "study.address", f"cannot listen on {host} port {port}: {reason}",
            "choose another --port (0 takes any free one) or --host",
        ) from None  # fmt: skip


async def _form(request: Request) -> list[tuple[str, str]]:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > FORM_LIMIT:
            raise HTTPException(413, "The form is too long.")
    try:
        return parse_qsl(body.decode("ascii"), keep_blank_values=True, strict_parsing=bool(body))
    except ValueError:
        raise HTTPException(400, "The form cannot be read.") from None


def _scores(form: list[tuple[str, str]], methods: tuple[str, ...]) -> dict[str, int]:
    """``place-1=4`` and so on as method -> score; every field must be one of ours."""
    places = {f"place-{place}": method for place, method in enumerate(methods, 1)}
    scores: dict[str, int] = {}
    for field, value in form:
        if field not in places or places[field] in scores:
            raise HTTPException(400, f"There is no single '{field}' in this question.")
        if value not in map(str, SCALE):
            raise HTTPException(400, f"A rating is a whole number from 1 to {max(SCALE)}, not '{value}'.")
        scores[places[field]] = int(value)
    return scores


def _check_origin(request: Request) -> None:
    """Refuse forms that another site's page sent."""
    origin = request.headers.get("origin")
    if origin and urlsplit(origin).netloc != request.headers.get("host"):
        raise HTTPException(403, "This form was sent by another site.")


@lru_cache(maxsize=64)
def _bare_png(path: Path) -> bytes:
    """The picture without its metadata, which may name the method."""
    out = io.BytesIO()
    with Image.open(path) as image:
        upright = ImageOps.exif_transpose(image)
        upright.convert("RGBA" if upright.has_transparency_data else "RGB").save(out, "PNG")
    return out.getvalue()
