"""No page holds a word that is known to be a slip."""

from codespell_lib import main
from documentation import PAGES


def test_spelling(capsys):
    found = main("--ignore-words-list", "fro", *map(str, PAGES))
    assert found == 0, capsys.readouterr().out
