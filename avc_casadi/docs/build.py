"""Build the documentation site: tutorials that are run, the guide's own pages, and the API from its docstrings.

python avc_casadi/docs/build.py [OUT]       # needs pip install -e '.[docs]'; default OUT: build/site

Warnings are errors, and so is a tutorial that fails. Nothing is taken from a network. Overwrites OUT.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from avc_casadi.docs.api_pages import write_api
from avc_casadi.docs.guide_pages import write_guide

DOCS = Path(__file__).parent
ROOT = DOCS.parents[1]
_STUDIES = (ROOT / "tests", ROOT / "tests" / "benchmarks")


def sources(folder: Path) -> None:
    """Collect in a folder what Sphinx reads."""
    for name in ("conf.py", "index.md"):
        shutil.copy(DOCS / name, folder / name)
    shutil.copytree(DOCS / "tutorials", folder / "tutorials")
    write_guide(folder / "guide", ROOT)
    write_api(folder / "api")


def main() -> int:
    """Build the site; returns Sphinx's exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", metavar="OUT", nargs="?", type=Path, default=ROOT / "build" / "site")
    out = parser.parse_args().out.resolve()
    from sphinx.cmd.build import build_main  # noqa: PLC0415 - --help works without the extra

    # Tutorials run in kernels of their own, one of them a study.
    os.environ["PYTHONPATH"] = os.pathsep.join([*map(str, _STUDIES), *filter(None, [os.environ.get("PYTHONPATH")])])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "site"
        folder.mkdir()
        sources(folder)
        return int(build_main(["-W", "--keep-going", "-q", "-b", "html", "-d", f"{name}/cache", str(folder), str(out)]))


if __name__ == "__main__":
    sys.exit(main())
