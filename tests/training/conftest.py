"""The scripts under training/pocket are programs beside the package; their tests import them from there."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "training" / "pocket"))
