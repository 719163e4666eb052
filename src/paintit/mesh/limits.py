"""Refusing what a file asks for beyond the limits that the settings state."""

from __future__ import annotations

from paintit.config import LimitConfig
from paintit.errors import MeshError


def check_limit(limits: LimitConfig, name: str, found: int, what: str) -> None:
    """Refuse ``found`` of ``what`` where it is more than the limit called ``name``.

    Raises:
        MeshError: ``mesh.limit``; the hint is the flag that would let it pass.
    """
    allowed = getattr(limits, name)
    if found > allowed:
        flag = f"--limits.{name.replace('_', '-')} {found}"
        raise MeshError(
            "mesh.limit", f"{what}: {found}, more than the limit of {allowed}", f"if you trust it, add {flag}"
        )


def mib(size: int) -> int:
    """``size`` bytes in MiB, rounded up."""
    return -(-size // 2**20)
