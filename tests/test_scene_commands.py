"""`avc simulate` and `avc simulate --screen`: the documented keys, exit codes, files and text."""

from avc_casadi.cli import main


def call(capsys, *arguments):
    code = main(list(arguments))
    return code, capsys.readouterr()


def test_an_unstable_scene_ends_with_1(capsys):
    code, out = call(capsys, "simulate", "scenes/stiff-wall-uncoupled")
    assert code == 1
    assert "does not settle" in out.err
    assert "buzzes" in out.out
