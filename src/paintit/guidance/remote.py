"""The hub and its cache, through ``huggingface_hub``, which respects ``HF_HOME``, ``HF_TOKEN``, ``HF_ENDPOINT`` and
``HF_HUB_OFFLINE``. Every way in which a repository can be refused becomes one line with the remedy. No torch."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from paintit.errors import PriorError
from paintit.guidance.known import instead_of

#: Seconds that the hub has to answer a question; downloads take as long as they take.
PATIENCE = 30


@dataclass(frozen=True)
class Listing:
    """What the hub says of a repository, before anything of it is fetched."""

    source: str
    revision: str
    """The commit."""
    sizes: Mapping[str, int]
    """Path -> bytes."""
    licence: str
    """As its card states it; may be empty."""


def ask(source: str, revision: str = "") -> Listing:
    """The files of the hub id ``source``.

    Raises:
        PriorError: the hub does not answer, has no such id or revision, or refuses.
    """
    from huggingface_hub import HfApi

    try:
        info = HfApi().model_info(source, revision=revision or None, files_metadata=True, timeout=PATIENCE)
    except Exception as error:
        raise _refused(error, source, revision) from error
    card = info.card_data
    sizes = {file.rfilename: file.size or 0 for file in info.siblings or ()}
    return Listing(source, info.sha or "", sizes, str(card.get("license") or "") if card else "")


def fetch(source: str, revision: str, files: Sequence[str]) -> Path:
    """Download ``files`` into the cache; the folder that holds them.

    Raises:
        PriorError: as :func:`ask`, or the download breaks off. What arrived is kept, and not fetched again.
    """
    from huggingface_hub import snapshot_download

    try:
        return Path(snapshot_download(source, revision=revision or None, allow_patterns=list(files)))
    except Exception as error:
        raise _refused(error, source, revision) from error


def cached(source: str, revision: str, file: str) -> Path | None:
    """A file of the hub id ``source`` in the local cache.

    Raises:
        PriorError: ``source`` cannot be a hub id.
    """
    from huggingface_hub import try_to_load_from_cache
    from huggingface_hub.errors import HFValidationError

    try:
        found = try_to_load_from_cache(source, file, revision=revision or None)
    except HFValidationError as error:
        raise _refused(error, source, revision) from error
    return Path(found) if isinstance(found, str) else None


def cached_folder(source: str) -> Path | None:
    """The folder in the local cache with all that was ever fetched of the newest known state of a hub id."""
    from huggingface_hub import constants
    from huggingface_hub.file_download import repo_folder_name

    place = Path(constants.HF_HUB_CACHE) / repo_folder_name(repo_id=source, repo_type="model")
    newest = place / "refs/main"
    folder = place / "snapshots" / newest.read_text("utf-8").strip() if newest.is_file() else None
    return folder if folder and folder.is_dir() else None


def hide_bars() -> None:
    """No progress bars of downloads, where nobody watches."""
    with contextlib.suppress(ImportError):  # who downloads says that it is needed
        from huggingface_hub.utils import disable_progress_bars

        disable_progress_bars()


def not_cached(source: str, revision: str) -> PriorError:
    at = f" at revision '{revision}'" if revision else ""
    return PriorError(
        "prior.not_cached",
        f"'{source}'{at} is not on this machine, and nothing is downloaded unasked",
        f"fetch it with 'paintit priors pull {source}', or add --allow-download (allow_download=True in Python)",
    )


def _refused(error: Exception, source: str, revision: str) -> PriorError:
    """``error`` of ``huggingface_hub`` in our form."""
    from huggingface_hub import constants, errors

    cause = error.__cause__ if isinstance(error, errors.LocalEntryNotFoundError) and error.__cause__ else error
    answer = getattr(cause, "response", None)
    status = getattr(answer, "status_code", None)
    if isinstance(cause, errors.HFValidationError):
        return PriorError("prior.missing", f"'{source}' is neither a folder nor a hub id", "check the path")
    if isinstance(cause, errors.OfflineModeIsEnabled):
        return PriorError(
            "prior.offline",
            f"'{source}' is not on this machine, and HF_HUB_OFFLINE forbids to fetch it",
            "unset HF_HUB_OFFLINE, or give a folder",
        )
    if isinstance(cause, errors.RevisionNotFoundError):
        return PriorError("prior.revision", f"'{source}' has no revision '{revision}'", "leave it out for the newest")
    unknown = isinstance(cause, errors.RepositoryNotFoundError) and not isinstance(cause, errors.GatedRepoError)
    if isinstance(cause, errors.DisabledRepoError) or unknown:
        return PriorError(
            "prior.withdrawn",
            f"{constants.ENDPOINT} has no '{source}': withdrawn, renamed or private",
            f"{instead_of(source)}; a private one needs HF_TOKEN",
        )
    if status in (401, 403):
        return PriorError(
            "prior.gated",
            f"'{source}' is gated: {_token_words()}",
            f"accept its licence at {constants.ENDPOINT}/{source}, then set HF_TOKEN to a token of that account",
        )
    reason = next(iter(str(cause).strip().splitlines()), "") or type(cause).__name__
    return PriorError(
        "prior.download",
        f"'{source}' cannot be downloaded: {f'{status}: ' if status else ''}{reason}",
        "check the connection and HF_ENDPOINT; what has arrived is kept",
    )


def _token_words() -> str:
    from huggingface_hub import get_token

    return "the account of your token has not been let in" if get_token() else "no token is given"
