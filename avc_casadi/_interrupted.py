"""Message of a command ended by Ctrl-C, independent of any module that the interrupt may have left half loaded."""

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
