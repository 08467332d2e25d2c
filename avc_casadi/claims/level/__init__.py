"""The levels of a certificate, one file each; a new file here is a new level."""
