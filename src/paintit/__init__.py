"""Give an untextured mesh and a sentence, get the same mesh back with physically based textures.

>>> import paintit
>>> mesh = paintit.load_mesh("chair.obj")                                            # doctest: +SKIP
>>> result = paintit.paint(mesh, "a carved oak chair with a red velvet seat")        # doctest: +SKIP
>>> result.export("chair.glb")                                                       # doctest: +SKIP

The names below are resolved on first use: importing the package loads neither torch nor anything else of weight.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from paintit._version import __version__ as __version__

if TYPE_CHECKING:
    from paintit.api import PaintResult as PaintResult
    from paintit.api import load_mesh as load_mesh
    from paintit.api import paint as paint
    from paintit.config import PaintConfig as PaintConfig
    from paintit.config import preset as preset
    from paintit.errors import PaintitError as PaintitError
    from paintit.paint.painter import Painter as Painter

_HOMES = {
    "PaintConfig": "paintit.config",
    "PaintResult": "paintit.api",
    "Painter": "paintit.paint.painter",
    "PaintitError": "paintit.errors",
    "load_mesh": "paintit.api",
    "paint": "paintit.api",
    "preset": "paintit.config",
}

__all__ = [
    "PaintConfig", "PaintResult", "Painter", "PaintitError", "__version__", "load_mesh", "paint", "preset",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'paintit' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """``paintit.paint`` is the function, also after the folder of that name has been imported.

    The import system binds every submodule as an attribute of its package; this leaves that one out. The folder is
    reached as usual: ``from paintit.paint.painter import Painter``.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name == "paint" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
