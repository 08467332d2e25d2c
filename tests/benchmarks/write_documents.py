"""Write the generated blocks of README, guide and pages anew, from results files and from the problem model.

python tests/benchmarks/write_documents.py

Overwrites the pages that hold a block between `<!-- results: NAME -->` or `<!-- keys: NAME -->` and `<!-- end -->`, and
in them nothing but the blocks.
"""

from generated_blocks import ROOT, pages, written
from script_arguments import script_arguments


def main() -> None:
    script_arguments(__doc__)
    for path in pages():
        text = written(path)
        if text != path.read_text(encoding="utf-8"):
            path.write_text(text, encoding="utf-8")
            print(f"written: {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
