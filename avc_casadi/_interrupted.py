"""What a command says that Ctrl-C ended: known before anything is loaded, needing nothing that it may have spoiled."""

DOCUMENT = """\
{
 "errors": [
  {
   "file": "",
   "line": null,
   "key": "",
   "message": "interrupted"
  }
 ]
}
"""
TEXT = "avc: interrupted\n"
EXIT_CODE = 130
