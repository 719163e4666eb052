"""The paper's tables and figures, rerun: ``python -m reproduction`` paints, measures and writes the page."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The material generator, which knows the truth of a prompt, is a set of scripts beside the package.
sys.path.insert(0, str(ROOT / "training" / "pocket"))
